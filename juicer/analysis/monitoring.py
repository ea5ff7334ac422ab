"""How unsure a policy is along its rollouts, and whether that tells beforehand which of them fail."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from juicer.episode import Outcome
from juicer.geometry import rot6d_to_matrix
from juicer.storage.analyses import MonitorRow

Measure = Literal["position_mm", "rotation_deg", "gripper", "disagreement_mm"]
MEASURES: tuple[Measure, ...] = get_args(Measure)
"""How far samples of a chunk are from their mean: positions [mm], rotations [degrees], gripper command; and how far the
mean of a chunk is from that of the chunk before, where both say something of the same steps [mm]."""

BOOTSTRAP_DRAWS = 2000
LEAST_COMPARED = 10
"""Failures, and successes, from which on a bootstrap over them tells how exact an area is."""


class Watcher:
    """Measures one prediction of an episode after the other."""

    def __init__(self, action_horizon: int) -> None:
        """Begin an episode of a policy that executes so many actions of a chunk."""
        self._executed = action_horizon
        self._before: NDArray[np.float64] | None = None

    def measure(self, chunks: NDArray[np.floating]) -> Mapping[str, float]:
        """Of samples ``(n, T_p, 10)`` of the next chunk, absolute; they are shorter by a little than a turn."""
        positions_mm = 1000 * chunks[..., :3].astype(np.float64)
        rotations = rot6d_to_matrix(chunks[..., 3:9])
        turned = (rotations - rotations.mean(axis=0)).reshape(*chunks.shape[:2], 9)
        mean = positions_mm.mean(axis=0)
        found = {
            "position_mm": _rms(positions_mm - mean),
            # Of small angles: the distance of two matrices is the angle times the root of two.
            "rotation_deg": float(np.rad2deg(_rms(turned) / np.sqrt(2))),
            "gripper": float(np.std(chunks[..., 9:], axis=0).mean()),
            "disagreement_mm": self._disagreement(mean),
        }
        self._before = mean
        return found

    def _disagreement(self, mean: NDArray[np.float64]) -> float:
        if self._before is None or len(mean) <= self._executed:
            return 0.0
        apart = self._before[self._executed :] - mean[: len(mean) - self._executed]
        return float(np.linalg.norm(apart, axis=-1).mean())


def _rms(vectors: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.square(vectors).sum(axis=-1).mean()))


@dataclass(frozen=True)
class Watched:
    """One measure along the rollouts of a policy.

    Attributes:
        scores: ``(E, S)`` of every episode, at every prediction the highest so far; NaN before a window is full, and
            after the episode's end.
        failed: ``(E,)`` which of them failed.
        lengths: ``(E,)`` steps.
        stride: Steps between predictions.
    """

    scores: NDArray[np.float64]
    failed: NDArray[np.bool_]
    lengths: NDArray[np.int64]
    stride: int

    @classmethod
    def of(
        cls,
        traces: Sequence[NDArray[np.float64]],
        failed: Sequence[bool],
        lengths: Sequence[int],
        stride: int,
        window: int,
    ) -> Watched:
        """Watch traces ``(S,)`` of episodes, each number replaced by the mean of the last ones in a window.

        There is no score before the window is full: means of fewer numbers spread more, and would decide the highest.
        """
        scores = np.full((len(traces), max(map(len, traces))), np.nan)
        for row, trace in zip(scores, traces, strict=True):
            summed = np.concatenate([[0.0], np.cumsum(trace)])
            smooth = (summed[window:] - summed[:-window]) / window
            row[window - 1 : len(trace)] = np.maximum.accumulate(smooth)
        return cls(scores, np.array(failed), np.array(lengths), stride)

    @property
    def before_any_success(self) -> int | None:
        """Place of the last prediction at which all episodes that succeed are still running; None if none succeeds.

        Later, that an episode is still running tells by itself that it may fail.
        """
        successes = self.lengths[~self.failed]
        return (int(successes.min()) - 1) // self.stride if len(successes) else None

    @property
    def _decided(self) -> NDArray[np.int64]:
        """``(E,)`` when a rollout was over, or half of those that succeed were; that it fails is plain then.

        A failure may go on until the limit, long after a part was dropped: steps until then are no warning.
        """
        successes = self.lengths[~self.failed]
        return np.minimum(self.lengths, int(np.median(successes))) if len(successes) else self.lengths

    def why_not_compared(self) -> str:
        """Why failures and successes cannot be compared before a success ends, as a clause; empty if they can be."""
        place = self.before_any_success
        if place is None:
            return "there is no success"
        if not self.failed.any():
            return "there is no failure"
        if np.isnan(self.scores[~self.failed, place]).any():
            return "the first success ends before a window of predictions is full"
        lost = np.isnan(self.scores[self.failed, place]).all()
        return "there is no failure that is still running when the first success ends" if lost else ""

    def separation(self, place: int) -> Separation | None:
        """How well the scores up to a prediction tell failures, of the episodes that are running then.

        None if no failure, or no success, is among these.
        """
        running = ~np.isnan(self.scores[:, place])
        bad = self.scores[running & self.failed, place]
        good = self.scores[running & ~self.failed, place]
        if not len(bad) or not len(good):
            return None
        return Separation((bad[:, None] > good) + 0.5 * (bad[:, None] == good))

    def curve(self) -> Iterator[tuple[int, float]]:
        """Steps, and area under the curve at each prediction at which there is one."""
        for place in range(self.scores.shape[1]):
            if found := self.separation(place):
                yield place * self.stride, found.auc

    def alarms(self, false_alarm_rate: float) -> Alarms:
        """Alarms at the first score above the one that this share of successful rollouts ever exceeds.

        The threshold for an episode is taken from successes of the other half of the episodes, so that the share of
        false alarms is a measurement. No rollout is watched for longer than the longest success lasts: failures last
        until the limit, and with more time chance alone would find more of them.
        """
        longest = int(self.lengths[~self.failed].max(initial=1))
        scores = self.scores[:, : -(-longest // self.stride)]
        # No measure is below zero; an episode that ends before its window is full raises no alarm.
        highest = np.fmax.reduce(scores, axis=1, initial=0.0)
        halves = np.arange(len(self.failed)) % 2
        steps = np.full(len(self.failed), -1)
        for half in (0, 1):
            known = highest[(halves != half) & ~self.failed]
            threshold = np.quantile(known, 1 - false_alarm_rate, method="higher") if len(known) else np.inf
            above = scores > threshold
            raised = above.any(axis=1) & (halves == half)
            steps[raised] = self.stride * above[raised].argmax(axis=1)
        raised = steps >= 0
        return Alarms(
            false_alarms=float(raised[~self.failed].mean()) if (~self.failed).any() else None,
            found=float(raised[self.failed].mean()) if self.failed.any() else None,
            leads=tuple(np.sort((self._decided - steps)[raised & self.failed]).tolist()),
        )


def watched(rows: Sequence[MonitorRow], measure: Measure, stride: int, window: int) -> Watched:
    """One measure of a table along all of its rollouts."""
    episodes: dict[int, list[MonitorRow]] = {}
    for row in rows:
        episodes.setdefault(row.episode, []).append(row)
    firsts = [found[0] for found in episodes.values()]
    return Watched.of(
        [np.array([getattr(row, measure) for row in found]) for found in episodes.values()],
        [first.outcome != Outcome.SUCCESS for first in firsts],
        [first.length for first in firsts],
        stride,
        window,
    )


@dataclass(frozen=True)
class Separation:
    """Failures against successes.

    Attributes:
        wins: ``(failures, successes)`` one where the failure has the higher score, a half where both are alike.
    """

    wins: NDArray[np.float64]

    @property
    def auc(self) -> float:
        """Area under the ROC curve: how often a failure has a higher score than a success."""
        return float(self.wins.mean())

    def interval(self, rng: np.random.Generator, level: float = 0.95) -> tuple[float, float]:
        """Bootstrap interval of the area, over failures and over successes.

        Of a few it would be far too narrow (of three failures, chance lies outside in a quarter of all cases): below
        :data:`LEAST_COMPARED` of either, every area is possible.
        """
        if min(self.wins.shape) < LEAST_COMPARED:
            return 0.0, 1.0
        bad, good = (rng.multinomial(size, np.full(size, 1 / size), BOOTSTRAP_DRAWS) / size for size in self.wins.shape)
        areas = np.einsum("df,fs,ds->d", bad, self.wins, good, optimize=True)
        low, high = np.quantile(areas, [0.5 - level / 2, 0.5 + level / 2])
        return float(low), float(high)


@dataclass(frozen=True)
class Alarms:
    """What a monitor that raises alarms comes to.

    Attributes:
        false_alarms: Share of successful rollouts with an alarm; None if there are none.
        found: Share of failing rollouts with an alarm; None if there are none.
        leads: Steps from each of these alarms to the end of its rollout, or to when half of the successes were over if
            that is earlier; below zero where it was raised later. Sorted.
    """

    false_alarms: float | None
    found: float | None
    leads: tuple[int, ...]
