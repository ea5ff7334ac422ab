"""Windows: split by episode first, then cut; never across episodes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.errors import TrainingFailed
from juicer.policy.config import HorizonConfig


@dataclass(frozen=True)
class TrainingEpisodes:
    """Episodes, one after another in time-major arrays.

    Attributes:
        observations: Arrays ``(S, D)`` by name, and images ``(S, H, W, 3)``, which may be larger than the memory.
        actions: Absolute actions ``(S, 10)``.
        episode_ends: ``(N,)`` index one past the last step of each episode.
        families: ``(N,)`` a label for each episode; those with the same label stay on the same side of the
            split. A snippet grown from a demonstration belongs to the demonstration's family.
        sources: ``(N,)`` where each episode comes from, e.g. ``teleop``; only to tell what became of them.
        weights: ``(N,)`` how often each window of an episode is learned from, as compared with those of others; all
            alike if empty.
    """

    observations: Mapping[str, NDArray[Any]]
    actions: NDArray[np.float32]
    episode_ends: NDArray[np.int64]
    families: Sequence[str]
    sources: Sequence[str]
    weights: Sequence[float] = ()

    def __post_init__(self) -> None:
        """Check that the arrays agree in length."""
        num_steps = int(self.episode_ends[-1]) if len(self.episode_ends) else 0
        lengths = {name: len(values) for name, values in {**self.observations, "action": self.actions}.items()}
        if set(lengths.values()) != {num_steps}:
            raise TrainingFailed(f"episodes end at step {num_steps}, but their arrays have lengths {lengths}")
        for thing, labels in {"family": self.families, "source": self.sources}.items():
            if len(labels) != len(self.episode_ends):
                raise TrainingFailed(f"{len(self.episode_ends)} episodes need a {thing} each, got {len(labels)}")
        if len(self.weights) not in (0, len(self.episode_ends)):
            raise TrainingFailed(f"{len(self.episode_ends)} episodes need a weight each, got {len(self.weights)}")


def concatenate(parts: Sequence[TrainingEpisodes]) -> TrainingEpisodes:
    """All episodes of several arrays in one; rows whose length depends on the task are filled up with zeros.

    Raises:
        TrainingFailed: If there is none.
    """
    if not sum(len(part.episode_ends) for part in parts):
        raise TrainingFailed("there are no episodes to train on")
    if len(parts) == 1:
        return parts[0]
    starts = np.cumsum([0, *(len(part.actions) for part in parts)])
    return TrainingEpisodes(
        observations={name: _end_to_end([part.observations[name] for part in parts]) for name in parts[0].observations},
        actions=np.concatenate([part.actions for part in parts]),
        episode_ends=np.concatenate([part.episode_ends + start for part, start in zip(parts, starts, strict=False)]),
        families=[family for part in parts for family in part.families],
        sources=[source for part in parts for source in part.sources],
        weights=[weight for part in parts for weight in part.weights or [1.0] * len(part.episode_ends)],
    )


def _end_to_end(arrays: Sequence[NDArray[Any]]) -> NDArray[Any]:
    if arrays[0].ndim == 2:
        longest = max(array.shape[1] for array in arrays)
        arrays = [np.pad(array, ((0, 0), (0, longest - array.shape[1]))) for array in arrays]
    return np.concatenate(arrays)


def split_episodes(
    families: Sequence[str], validation_fraction: float, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of the episodes to train on and of those held out, whole families together.

    Neighbouring windows share nearly all their steps, so a split by windows would validate on training data.

    Raises:
        TrainingFailed: If a validation set is wanted but there is only one family.
    """
    names = sorted(set(families))
    held_out = math.ceil(validation_fraction * len(names))
    if held_out >= len(names):
        raise TrainingFailed(
            f"{len(names)} independent episode(s) cannot be split into training and validation; "
            "add demonstrations or set validation_fraction to 0"
        )
    chosen = {names[index] for index in rng.permutation(len(names))[:held_out]}
    is_held_out = np.array([family in chosen for family in families])
    return np.flatnonzero(~is_held_out), np.flatnonzero(is_held_out)


def window_weights(episodes: TrainingEpisodes, windows: Windows) -> NDArray[np.float64] | None:
    """How often each window is learned from as compared with others ``(W,)``; None if all are alike."""
    weights = np.array(episodes.weights, dtype=np.float64)
    if len(set(weights.tolist())) < 2:
        return None
    return weights[np.searchsorted(episodes.episode_ends, windows.obs_steps[:, -1], side="right")]


@dataclass(frozen=True)
class Windows:
    """Windows as indices into time-major arrays.

    Attributes:
        episodes: ``(E,)`` episodes that they were cut from, those too short for a window included.
        obs_steps: ``(W, T_o)`` observed steps, the last of which is the current one.
        action_steps: ``(W, T_p)`` steps whose actions are predicted, from the first observed step on.
        is_recorded: ``(W, T_p)`` False where the first or last action is repeated beyond its episode.
    """

    episodes: NDArray[np.int64]
    obs_steps: NDArray[np.int64]
    action_steps: NDArray[np.int64]
    is_recorded: NDArray[np.bool_]

    def __len__(self) -> int:
        """Number of windows."""
        return len(self.obs_steps)


def cut_windows(
    episode_ends: NDArray[np.int64], episodes: NDArray[np.int64], horizons: HorizonConfig, back_padding: int
) -> Windows:
    """Windows of the chosen episodes.

    In front of an episode its first step is repeated ``T_o - 1`` times, so that every step can be the current
    one; behind it its last step is repeated ``back_padding`` times. An episode of length L gives
    ``max(0, L + T_o - 1 + back_padding - T_p + 1)`` windows, and never more than L.
    """
    front_padding = horizons.obs - 1
    episode_starts = np.concatenate([[0], episode_ends[:-1]])
    firsts, lows, highs = [], [], []
    for low, end in zip(episode_starts[episodes], episode_ends[episodes], strict=True):
        # The current step, front_padding after the first of its window, must lie within the episode.
        last = min(end + back_padding - horizons.pred, end - 1 - front_padding)
        first = np.arange(low - front_padding, last + 1)
        firsts.append(first)
        lows.append(np.full(len(first), low))
        highs.append(np.full(len(first), end - 1))
    first_step, low_step, high_step = (np.concatenate([[], *parts]).astype(np.int64) for parts in (firsts, lows, highs))
    steps = first_step[:, None] + np.arange(horizons.pred)
    inside = np.clip(steps, low_step[:, None], high_step[:, None])
    return Windows(
        episodes=episodes, obs_steps=inside[:, : horizons.obs], action_steps=inside, is_recorded=steps == inside
    )
