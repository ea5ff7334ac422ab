"""Demonstrations on an annotator's desk: what is proposed, what people said, images and signals, by step."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.annotation.remaining import remaining_critical_states
from juicer.annotation.signals import signals_of
from juicer.annotation.standing import Standing, standing
from juicer.annotation.versions import Key, read_versions, versions_path
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.episode import RECORDED_STEP_KEY, Episode, Outcome
from juicer.errors import NothingLeft
from juicer.pages.annotating.proposals import Proposals, Search, find_proposals
from juicer.pages.annotating.sheets import draw_sheet
from juicer.pages.annotating.work import Demonstration, Judgement, Opinion, Proposed
from juicer.pages.workplace import Workplace
from juicer.sim.env import AssemblyEnv
from juicer.storage.episodes import EpisodeReader
from juicer.tasks.registry import get_task

_MOST_DESKS = 4
_MOST_SEARCHES = 256
_MOST_EPISODES = 8


class Desk:
    """The demonstrations of one artifact of episodes. Any thread may use it.

    Attributes:
        reader: The episodes.
        task: Their task.
        path: File of the versions of annotations.
    """

    def __init__(self, reader: EpisodeReader, path: Path, search: Search) -> None:
        """Use :func:`desk_of`."""
        self.reader = reader
        self.task = get_task(self.reader.records[0].task)
        self.path = path
        self._env_lock = threading.Lock()
        self.read = lru_cache(_MOST_EPISODES)(self._read)
        self.signals = lru_cache(_MOST_EPISODES)(self._signals)
        self._search = search

    @property
    def names(self) -> tuple[str, ...]:
        """What happens at each critical state."""
        return self.task.critical_state_names

    def proposals(self, patience_s: float = 0.0) -> Proposals | None:
        """Proposals by episode and critical state; see :meth:`~juicer.pages.annotating.proposals.Search.proposals`."""
        return self._search.proposals(patience_s)

    @property
    def proposed(self) -> int:
        """How many demonstrations have been searched for critical states."""
        return self._search.searched

    def sheet(self, episode_id: str, first: int, count: int, views: Iterable[str]) -> bytes:
        """JPEG of some steps; see :func:`draw_sheet`."""
        return draw_sheet(self.read(episode_id), first, count, tuple(views))

    def work(self) -> list[Demonstration]:
        """Every demonstration with what is proposed and said of it, those first that are most in doubt."""
        proposals = self.proposals() or {}
        stands = standing(read_versions(self.path))
        states = range(self.task.num_critical_states)
        episodes = [
            Demonstration(
                id=record.episode_id,
                log=record.log or record.episode_id,
                steps=int(length),
                marks=[self.judgement((record.episode_id, state), stands, proposals) for state in states],
            )
            for record, length in zip(self.reader.records, self.reader.lengths, strict=True)
            if record.outcome is Outcome.SUCCESS
        ]
        return sorted(episodes, key=lambda episode: episode.confidence)

    def judgement(self, key: Key, stands: Mapping[Key, Standing], proposals: Proposals) -> Judgement:
        """What is proposed and said of one critical state, in steps of the episode."""
        episode_id, state = key
        stand, proposal = stands.get(key, Standing(0, ())), proposals.get(key)
        agreed = stand.agreed
        return Judgement(
            episode=episode_id,
            critical_state=state,
            expected=proposal is not None or episode_id not in self._ahead or state in self._ahead[episode_id],
            proposal=Proposed(proposal.step, proposal.confidence) if proposal else None,
            newest=stand.newest,
            opinions=[
                Opinion(version.author, self.step_of(version.episode, version.step), version.version)
                for version in stand.opinions
            ],
            agreed=self.step_of(agreed.episode, agreed.step) if agreed else None,
            disputed=stand.is_disputed,
        )

    def step_of(self, episode_id: str, recorded: int | None) -> int | None:
        """Step of the episode that a step of its recording became; see :meth:`Episode.step_of`."""
        numbers = self._numbers[self.reader.find(episode_id)]
        if recorded is None or recorded > numbers[-1]:
            return None
        return max(int(np.searchsorted(numbers, recorded, side="right")) - 1, 0)

    def recorded_step(self, episode_id: str, step: int) -> int:
        """Number of a step in the recording.

        Raises:
            NothingLeft: If there is no such step.
        """
        numbers = self._numbers[self.reader.find(episode_id)]
        if step >= len(numbers):
            raise NothingLeft(f"demonstration {episode_id} has the steps 0 to {len(numbers) - 1}, and not {step}")
        return int(numbers[step])

    def check_episode(self, episode_id: str) -> None:
        """Refuse a demonstration that is not among these.

        Raises:
            ArtifactError: If it is not.
        """
        self.reader.find(episode_id)

    def check_critical_state(self, index: int) -> None:
        """Refuse a critical state that the task does not have.

        Raises:
            NothingLeft: If it has none of this index.
        """
        if index >= len(self.names):
            raise NothingLeft(
                f"{self.task.name} has {len(self.names)} critical states, numbered from 0, and not {index}"
            )

    @cached_property
    def _numbers(self) -> list[NDArray[np.int64]]:
        """Numbers of the steps of every episode in its recording."""
        if RECORDED_STEP_KEY not in self.reader.schema:
            return [np.arange(length) for length in self.reader.lengths]
        numbers = np.asarray(self.reader.steps(RECORDED_STEP_KEY), dtype=np.int64)
        return np.split(numbers, self.reader.episode_ends[:-1])

    @cached_property
    def _ahead(self) -> Mapping[str, frozenset[int]]:
        """Critical states that lie ahead of the first state of every correction."""
        return {
            record.episode_id: remaining_critical_states(self.task, self.reader.read(number))
            for number, record in enumerate(self.reader.records)
            if record.parent is not None
        }

    @cached_property
    def _env(self) -> AssemblyEnv:
        return AssemblyEnv(self.task.name)

    def _read(self, episode_id: str) -> Episode:
        return self.reader.read(self.reader.find(episode_id))

    def _signals(self, episode_id: str) -> dict[str, Any]:
        episode = self.read(episode_id)
        with self._env_lock:
            found = asdict(signals_of(self._env, episode))
        return {name: _rounded(values) for name, values in found.items()}


def desk_of(workplace: Workplace, name: str) -> tuple[ArtifactRef, Desk]:
    """An artifact of episodes, checked to be still there, with its desk.

    Args:
        workplace: Where it is.
        name: Id of the artifact, or its first letters.

    Raises:
        ArtifactError: If there is none, or it is damaged.
        NothingLeft: If it holds no episode.
        StateMissing: If its episodes hold no simulator states.
    """
    ref = workplace.store.resolve(name, "episodes")
    folder = workplace.store.open(ref, "episodes")
    # The first requests of a page come together, and are to share one search for proposals.
    with _DESK_LOCK:
        return ref, _desk(workplace.store, ref, folder, workplace.folder, workplace.workers)


_DESK_LOCK = threading.Lock()


@lru_cache(_MOST_DESKS)
def _desk(store: ArtifactStore, ref: ArtifactRef, folder: Path, data: Path, workers: int) -> Desk:
    reader = EpisodeReader(folder)
    if not len(reader):
        raise NothingLeft(f"{ref} holds no episode, so there is nothing to annotate")
    reader.require_state()
    return Desk(reader, versions_path(data, reader.records[0].task), _search(store, ref, folder, data, workers))


@lru_cache(_MOST_SEARCHES)
def _search(store: ArtifactStore, ref: ArtifactRef, folder: Path, data: Path, workers: int) -> Search:
    """Outlives a desk that makes room for others: what it finds is small, and takes long to find."""
    return Search(lambda progress: find_proposals(store, data, ref, EpisodeReader(folder), workers, progress))


def _rounded(values: Any) -> Any:
    if isinstance(values, tuple):
        return [_rounded(each) for each in values]
    return np.round(values, 4).tolist() if values.dtype.kind == "f" else values.astype(int).tolist()
