"""How much of the episodes a training really learns from: an episode shorter than a window may give none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juicer.errors import TrainingFailed
from juicer.policy.config import TASK_KEY, HorizonConfig
from juicer.training.windows import TrainingEpisodes, Windows

NOTABLE_SHARE = 0.1
"""Share of a source's steps or episodes that may go unused without a word."""
MOST_UNUSED_SHARE = 0.5
"""Share of a source's steps above which it was gathered in vain, and the training is refused."""


@dataclass(frozen=True)
class SourceUse:
    """What windows reach of the episodes of one source.

    A step is used if it is the current one of a window: only what is observed there teaches the policy how to act
    there.

    Attributes:
        episodes: Episodes given, those held out included.
        timesteps: Their steps.
        windows: Windows that are learned from.
        validation_episodes: Episodes held out.
        validation_windows: Their windows.
        unused_episodes: Episodes without any window, on either side of the split.
        unused_timesteps: Steps that are the current one of no window, on either side.
        unseen_timesteps: Those of them whose action is not even predicted from an earlier step.
    """

    episodes: int
    timesteps: int
    windows: int
    validation_episodes: int
    validation_windows: int
    unused_episodes: int
    unused_timesteps: int
    unseen_timesteps: int

    @property
    def unused_share(self) -> float:
        """Unused part of the steps, or of the episodes, whichever is larger."""
        return max(self.unused_timesteps / self.timesteps, self.unused_episodes / self.episodes)


def measure_use(episodes: TrainingEpisodes, learned: Windows, held_out: Windows) -> dict[str, SourceUse]:
    """What windows reach of every source, in the order in which the sources first occur."""
    sides = (_Reached(episodes, learned), _Reached(episodes, held_out))
    windows = sides[0].windows + sides[1].windows
    seen = sides[0].seen | sides[1].seen
    lengths = np.diff(episodes.episode_ends, prepend=0)
    of_step = np.repeat(np.arange(len(lengths)), lengths)
    unseen = np.bincount(of_step[~seen], minlength=len(lengths))
    use = {}
    for source in dict.fromkeys(episodes.sources):
        own = np.array([other == source for other in episodes.sources])
        aside = own & sides[1].is_chosen
        use[source] = SourceUse(
            episodes=int(own.sum()),
            timesteps=int(lengths[own].sum()),
            windows=int(sides[0].windows[own].sum()),
            validation_episodes=int(aside.sum()),
            validation_windows=int(sides[1].windows[own].sum()),
            unused_episodes=int((windows[own] == 0).sum()),
            unused_timesteps=int((lengths - windows)[own].sum()),
            unseen_timesteps=int(unseen[own].sum()),
        )
    return use


class _Reached:
    """What the windows of one side of the split reach.

    Attributes:
        windows: ``(N,)`` windows of each episode.
        seen: ``(S,)`` whether a step is observed or its recorded action is predicted in a window.
        is_chosen: ``(N,)`` whether an episode is on this side.
    """

    def __init__(self, episodes: TrainingEpisodes, windows: Windows) -> None:
        owners = np.searchsorted(episodes.episode_ends, windows.obs_steps[:, -1], side="right")
        self.windows: NDArray[np.int64] = np.bincount(owners, minlength=len(episodes.episode_ends))
        self.seen = np.zeros(len(episodes.actions), dtype=bool)
        self.seen[windows.obs_steps] = True
        self.seen[windows.action_steps[windows.is_recorded]] = True
        self.is_chosen = np.zeros(len(episodes.episode_ends), dtype=bool)
        self.is_chosen[windows.episodes] = True


def check_use(use: Mapping[str, SourceUse], horizons: HorizonConfig, back_padding: int) -> None:
    """Refuse a training that would leave out most of what was gathered for it.

    Raises:
        TrainingFailed: If more than half of a source's steps are used by no window.
    """
    source, worst = max(use.items(), key=lambda entry: entry[1].unused_timesteps / entry[1].timesteps)
    if worst.unused_timesteps > MOST_UNUSED_SHARE * worst.timesteps:
        raise TrainingFailed(f"{_lost(source, worst)}; {_remedy(source, horizons, back_padding)}")


def check_tasks(episodes: TrainingEpisodes, learned: Windows, tasks: Sequence[str]) -> None:
    """Refuse a training for several tasks that would learn nothing of one of them.

    Raises:
        TrainingFailed: Naming the task.
    """
    if TASK_KEY not in episodes.observations:
        return
    seen = set(np.unique(episodes.observations[TASK_KEY][learned.obs_steps]).astype(int).tolist())
    if lacking := [name for number, name in enumerate(tasks) if number not in seen]:
        raise TrainingFailed(
            f"nothing of {', '.join(lacking)} is left to learn from beside the episodes that are held out; add "
            "demonstrations of it or lower validation_fraction"
        )


def notable_losses(use: Mapping[str, SourceUse], horizons: HorizonConfig, back_padding: int) -> Iterator[str]:
    """A sentence for every source of which a notable share goes unused."""
    for source, counts in use.items():
        if counts.unused_share > NOTABLE_SHARE:
            yield f"{_lost(source, counts)}; {_remedy(source, horizons, back_padding)}"


def _lost(source: str, counts: SourceUse) -> str:
    begun = counts.timesteps - counts.unused_timesteps
    return (
        f"of {counts.timesteps:,} {source} steps only {begun:,} begin a window, and {counts.unused_episodes:,} of "
        f"{counts.episodes:,} {source} episodes have none"
    )


def _remedy(source: str, horizons: HorizonConfig, back_padding: int) -> str:
    longer = "augment.steps_after_gripper_change" if source == "augmentation" else "the length of the episodes"
    return (
        f"a window takes {horizons.pred} actions (policy.horizons.pred), of which {back_padding} may lie beyond the "
        f"end of its episode (training.windows.back_padding); raise back_padding to {horizons.pred - horizons.obs} to "
        f"lose none, lower horizons.pred, or raise {longer}"
    )
