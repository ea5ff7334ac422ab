"""Do the images decide? A policy acts on what it sees, and then on images of another episode.

    python -m benchmarks.image_control CHECKPOINT DEMONSTRATIONS [--data data] [--episodes 40] [--randomness low]

CHECKPOINT is the id of a policy that looks at images, DEMONSTRATIONS that of episodes of its task, as ``juicer ls``
prints them. In the control the policy has its own proprioception, and sees the images of the first of these episodes at
the step at which it is itself. One that assembles as often as before has not looked.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.artifacts.store import ArtifactStore
from juicer.episode import STATE_KEY, Episode, Outcome
from juicer.evaluation import milestone_counts, wilson_interval
from juicer.imaging.renderer import ViewRenderer
from juicer.policy.acting import TrainedPolicy
from juicer.policy.checkpoint import load_checkpoint
from juicer.rollout import Policy, rollout
from juicer.seed_ranges import Purpose, claim
from juicer.sim.sections import joint_positions
from juicer.storage.episodes import EpisodeReader
from juicer.tasks.registry import get_task
from juicer.views import ImageSpec


class ShownOtherImages:
    """A policy that is shown the images of a recorded episode instead of its own."""

    def __init__(self, policy: TrainedPolicy, episode: Episode) -> None:
        """Draw them when they are asked for."""
        self._policy = policy
        self.obs_horizon, self.action_horizon = policy.obs_horizon, policy.action_horizon
        self.observations = tuple(spec for spec in policy.observations if not isinstance(spec, ImageSpec))
        self._views = {spec.name: spec.view for spec in policy.observations if isinstance(spec, ImageSpec)}
        task = episode.record.task
        self._positions = joint_positions(get_task(task), np.asarray(episode.steps[STATE_KEY]))
        self._end_effector = np.asarray(episode.steps["proprioception"])[:, :3]
        self._renderer = ViewRenderer(task)
        # The streams themselves are kept: the number that tells one from others may be given to a later one.
        self._steps: Counter[np.random.Generator] = Counter()

    def predict(
        self, observations: Mapping[str, NDArray[Any]], streams: Sequence[np.random.Generator]
    ) -> NDArray[np.float32]:
        """See :class:`juicer.rollout.Policy`; every episode has a stream of its own, by which it is known."""
        last = len(self._positions) - 1
        now = [min(self._steps[stream], last) for stream in streams]
        self._steps.update(dict.fromkeys(streams, self.action_horizon))
        seen = {
            name: np.stack([
                [self._renderer.draw(self._positions[step], view, self._end_effector[step])] * self.obs_horizon
                for step in now
            ])
            for name, view in self._views.items()
        }  # fmt: skip
        return self._policy.predict({**observations, **seen}, streams)


def main() -> None:
    """Roll out both, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint")
    parser.add_argument("demonstrations")
    parser.add_argument("--data", type=Path, default=Path("data"), help="folder of the artifacts")
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--randomness", default="low", choices=("low", "med", "high"), help="of the initial states")
    parser.add_argument("--envs", type=int, default=8)
    parser.add_argument("--max-steps", type=int, help="steps of an episode; those of the task if left out")
    options = parser.parse_args()
    store = ArtifactStore(options.data)
    checkpoint = store.resolve(options.checkpoint, "checkpoint")
    episodes = store.resolve(options.demonstrations, "episodes")
    demonstration = EpisodeReader(store.open(episodes, "episodes")).read(0)
    policy = load_checkpoint(store.open(checkpoint, "checkpoint")).policy(demonstration.record.task)
    for name, acting in (("its own images", policy), ("another episode's", ShownOtherImages(policy, demonstration))):
        print(f"{name:<18} {_account(acting, demonstration.record.task, options)}", flush=True)


def _account(policy: Policy, task: str, options: argparse.Namespace) -> str:
    episodes = options.episodes
    seeds = claim(Purpose.EVALUATION, 0, episodes)
    runs = rollout(policy, task, options.randomness, seeds, num_envs=options.envs, max_steps=options.max_steps)
    records = [each.record for each in runs]
    successes = sum(record.outcome is Outcome.SUCCESS for record in records)
    low, high = wilson_interval(successes, episodes)
    reached = milestone_counts([record.milestones for record in records], get_task(task).milestones)
    funnel = ", ".join(f"{name} {count}" for name, count in reached.items())
    return f"{successes} of {episodes} ({low:.0%} to {high:.0%}): {funnel}"


if __name__ == "__main__":
    main()
