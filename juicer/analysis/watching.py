"""What a policy saw at steps of an episode, and what it might have done there instead."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from juicer.episode import ArraySpec, Episode
from juicer.errors import ConfigError
from juicer.observer import Observer
from juicer.sim.env import AssemblyEnv
from juicer.views import ImageSpec

if TYPE_CHECKING:
    from juicer.policy.acting import TrainedPolicy
    from juicer.policy.replay import ReplayPolicy


class Seeing(Protocol):
    """A policy, as far as it observes."""

    @property
    def observations(self) -> tuple[ArraySpec, ...]:
        """What it sees."""
        ...

    @property
    def obs_horizon(self) -> int:
        """How many steps of it, T_o."""
        ...


def sampling_policy(policy: TrainedPolicy | ReplayPolicy) -> TrainedPolicy:
    """The policy, if it draws samples.

    Raises:
        ConfigError: If it always predicts the same.
    """
    if not getattr(policy, "draws_samples", False):
        raise ConfigError("the policy predicts the same whenever it sees the same: it has no samples to analyse")
    return cast("TrainedPolicy", policy)


def seen_at(policy: Seeing, episode: Episode, steps: Iterable[int]) -> Mapping[str, NDArray[Any]]:
    """What a policy sees at some steps of an episode: ``(S, T_o, ...)`` by name.

    Numbers are those that were recorded. Images are drawn from the recorded states, so they are the same bytes.

    Raises:
        StateMissing: If images are to be drawn, and the episode has no simulator states.
        RenderingUnavailable: If no OpenGL platform can draw them.
    """
    wanted = np.maximum(np.asarray(list(steps))[:, None] + np.arange(1 - policy.obs_horizon, 1), 0)
    seen: dict[str, NDArray[Any]] = {
        spec.name: episode.steps[spec.name][wanted] for spec in policy.observations if spec.name in episode.steps
    }
    images = [spec for spec in policy.observations if isinstance(spec, ImageSpec)]
    return seen | _images(images, episode, wanted) if images else seen


def _images(specs: Sequence[ImageSpec], episode: Episode, wanted: NDArray[np.integer]) -> dict[str, NDArray[Any]]:
    observer = Observer(specs)
    drawn: dict[int, Mapping[str, NDArray[Any]]] = {}
    env = AssemblyEnv(episode.record.task)
    try:
        for step in np.unique(wanted).tolist():
            env.set_state(episode.state(step))
            drawn[step] = observer.see(env)
    finally:
        env.close()
    return {
        spec.name: np.stack([np.stack([drawn[step][spec.name] for step in row]) for row in wanted.tolist()])
        for spec in specs
    }
