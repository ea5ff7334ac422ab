"""Which states an estimator is shown: recorded ones, displaced to learn from, and as they were to be measured on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juicer.displacements import Displacements
from juicer.episode import STATE_KEY
from juicer.errors import NothingLeft
from juicer.estimation.perturbation import Perturbation, Scene
from juicer.seeding import stream
from juicer.storage.annotations import Annotation
from juicer.storage.episodes import EpisodeReader

NEAR_STEPS = 20
"""Steps before and after a critical state that count as around it."""
MEASURED_STEPS = 8
"""Steps before and after it over which errors are measured."""
MEASURED_EVERY = 2
"""Of the steps of demonstrations that are held out, one in so many is looked at."""
NOWHERE = -1


@dataclass(frozen=True)
class ChosenSteps:
    """Steps of stored episodes, counted over all of them.

    Attributes:
        steps: ``(N,)``.
        critical_states: ``(N,)`` the critical state that each is close to, by its index, or ``NOWHERE``.
    """

    steps: NDArray[np.int64]
    critical_states: NDArray[np.int64]


class Recorded:
    """Recorded steps of demonstrations and their critical states, those to learn from and those held out.

    Raises:
        NothingLeft: If there are fewer than two demonstrations.
    """

    def __init__(
        self, reader: EpisodeReader, annotations: Sequence[Annotation], held_out_share: float, seed: int
    ) -> None:
        """Split the demonstrations at random."""
        count = len(reader)
        if count < 2:
            raise NothingLeft("an estimator needs two demonstrations: one to learn from, one to be measured on")
        aside = min(max(round(held_out_share * count), 1), count - 1)
        order = stream(seed, "held out").permutation(count)
        owner = np.repeat(np.arange(count), reader.lengths)
        self._seed = seed
        self._is_held_out = np.isin(owner, order[:aside])
        self._is_around = _around(reader, annotations, NEAR_STEPS) != NOWHERE
        self._close_to = _around(reader, annotations, MEASURED_STEPS)

    def to_learn_from(self, number: int, near_critical: float) -> ChosenSteps:
        """So many steps, drawn at random, of which a share lies around critical states."""
        learned, around = ~self._is_held_out, self._is_around
        chances = np.zeros(len(around))
        for share, side in ((near_critical, learned & around), (1 - near_critical, learned & ~around)):
            chances[side] = share / max(side.sum(), 1)
        chances = chances if chances.any() else learned.astype(float)
        drawn = np.sort(stream(self._seed, "steps").choice(len(chances), number, p=chances / chances.sum()))
        return ChosenSteps(drawn, self._close_to[drawn])

    def to_be_measured_on(self) -> ChosenSteps:
        """Steps of the demonstrations that are held out."""
        steps = np.flatnonzero(self._is_held_out)[::MEASURED_EVERY]
        return ChosenSteps(steps, self._close_to[steps])


def displaced(reader: EpisodeReader, steps: NDArray[np.int64], config: Displacements, seed: int) -> Iterator[Scene]:
    """Recorded steps in ascending order, displaced; each depends on nothing but the seed and its place among them.

    Raises:
        StateMissing: If the episodes hold no simulator states.
        InvalidEpisode: If a state is none of the task's scene.
    """
    reader.require_state()
    perturbation = Perturbation(reader.records[0].task, config)
    owners = np.searchsorted(reader.episode_ends, steps, side="right")
    number = 0
    for episode in np.unique(owners).tolist():
        end = int(reader.episode_ends[episode])
        first = end - int(reader.lengths[episode])
        states = reader.steps(STATE_KEY, slice(first, end))
        for step in steps[owners == episode].tolist():
            yield perturbation.displace(states[step - first], stream(seed, "displacement", number))
            number += 1


def _around(reader: EpisodeReader, annotations: Sequence[Annotation], reach: int) -> NDArray[np.int64]:
    """The critical state around which every step lies, or ``NOWHERE``."""
    found = np.full(int(reader.lengths.sum()), NOWHERE)
    for row in annotations:
        episode = reader.find(row.episode_id)
        end = int(reader.episode_ends[episode])
        first = end - int(reader.lengths[episode])
        found[max(first, first + row.step - reach) : min(end, first + row.step + reach + 1)] = row.critical_state
    return found
