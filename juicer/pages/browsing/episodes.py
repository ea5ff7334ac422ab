"""Episodes of an artifact as a page lists them, and the recording behind each, if there is one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.episode import STATE_KEY, Episode, EpisodeRecord, Outcome
from juicer.errors import ArtifactNotFound, ConfigError, EvaluationOnly, NotCorrectable, WrongArtifactKind
from juicer.provenance import provenance
from juicer.storage.episodes import EpisodeReader
from juicer.storage.evaluations import EXAMPLES, read_evaluation
from juicer.tasks.registry import get_task
from juicer.teleoperation.origin import require_correctable

KINDS_WITH_EPISODES = ("episodes", "evaluation")


@dataclass(frozen=True)
class Line:
    """An episode in a list.

    Attributes:
        number: Its number in the artifact.
        seed: Seed of its initial state.
        outcome: How it ended.
        length: Its steps.
        parts_assembled: Pairs assembled at its end.
        milestones: Step at which each milestone was reached.
        origin: Where it comes from, as far as that is known, e.g. who recorded it.
        place: Its number among the recorded ones; None if only this line was kept of it.
        is_correctable: Whether a person may finish it by hand.
    """

    number: int
    seed: int
    outcome: Outcome
    length: int
    parts_assembled: int
    milestones: Mapping[str, int]
    origin: str = ""
    place: int | None = None
    is_correctable: bool = False

    def lacks(self, milestones: Sequence[str]) -> str:
        """The first milestone that it did not reach; empty for a success, which may begin behind some."""
        if self.outcome is Outcome.SUCCESS:
            return ""
        return next((name for name in milestones if name not in self.milestones), "")

    @property
    def last_reached(self) -> int:
        """Step of its latest milestone, behind which to look for what went wrong; 0 if it reached none."""
        return max(self.milestones.values(), default=0)


@dataclass(frozen=True)
class EpisodeList:
    """Episodes of an artifact.

    Attributes:
        ref: The artifact.
        task: The assembly task; empty if it is not known.
        milestones: Of the task, in order.
        lines: Every episode.
        has_states: Whether the recorded ones can be drawn.
    """

    ref: ArtifactRef
    task: str
    milestones: tuple[str, ...]
    lines: tuple[Line, ...]
    has_states: bool

    @property
    def is_recorded(self) -> bool:
        """Whether there is a recording of any of them."""
        return any(line.place is not None for line in self.lines)

    @property
    def first_recorded(self) -> int:
        """Number of the first episode that there is a recording of.

        Raises:
            ArtifactNotFound: If there is none.
        """
        number = next((line.number for line in self.lines if line.place is not None), None)
        if number is None:
            raise ArtifactNotFound(f"{self.ref} holds no recorded episode")
        return number

    def chosen(self, outcome: str, lacking: str) -> list[Line]:
        """Those of an outcome (``failure``: of any but success) whose first missing milestone is the given one."""
        return [
            line
            for line in self.lines
            if outcome in ("", line.outcome) or (outcome == "failure" and line.outcome is not Outcome.SUCCESS)
            if not lacking or lacking == line.lacks(self.milestones)
        ]

    def line(self, number: int) -> Line:
        """The episode of a number.

        Raises:
            ArtifactNotFound: If there is none.
        """
        if not self.lines:
            raise ArtifactNotFound(f"{self.ref} holds no episodes")
        if not 0 <= number < len(self.lines):
            raise ArtifactNotFound(f"{self.ref} has episodes 0 to {len(self.lines) - 1}, not {number}")
        return self.lines[number]


def list_episodes(store: ArtifactStore, ref: ArtifactRef) -> EpisodeList:
    """Every episode of an artifact.

    Raises:
        WrongArtifactKind: If it is of a kind that has none.
        ArtifactError: If it is missing or damaged.
    """
    if ref.kind not in KINDS_WITH_EPISODES:
        raise WrongArtifactKind(f"{ref} holds no episodes; artifacts of the kinds 'episodes' and 'evaluation' do")
    folder = store.open(ref)
    if ref.kind == "evaluation":
        # An evaluation that was unpacked from the records of a study has its rows, but none of its examples.
        tasks = tuple(store.manifest(ref).recipe.tasks)
        return _evaluated(ref, folder, tasks[0] if len(tasks) == 1 else "", (folder / EXAMPLES).is_dir())
    return _stored(ref, folder)


def recorded_episode(store: ArtifactStore, ref: ArtifactRef, number: int) -> Episode:
    """The recording of an episode.

    Raises:
        ArtifactNotFound: If there is no such episode, or none was kept of it.
        ArtifactError: If the artifact is missing or damaged.
    """
    place = list_episodes(store, ref).line(number).place
    if place is None:
        raise ArtifactNotFound(
            f"{ref} kept no recording of episode {number}; "
            f"`juicer replay {ref.id} --episode {number}` computes it again"
        )
    return _recorded(_recordings_folder(ref, store.open(ref)), place)


def _recordings_folder(ref: ArtifactRef, folder: Path) -> Path:
    return folder / EXAMPLES if ref.kind == "evaluation" else folder


@lru_cache(maxsize=8)
def _recorded(folder: Path, place: int) -> Episode:
    return EpisodeReader(folder).read(place)


@lru_cache(maxsize=8)
def _stored(ref: ArtifactRef, folder: Path) -> EpisodeList:
    reader = EpisodeReader(folder)
    lines = tuple(
        Line(
            number=number,
            seed=record.seed,
            outcome=record.outcome,
            length=int(reader.lengths[number]),
            parts_assembled=record.parts_assembled,
            milestones=record.milestones,
            origin=", ".join(provenance(record)),
            place=number,
            is_correctable=_is_correctable(record),
        )
        for number, record in enumerate(reader.records)
    )
    task = reader.records[0].task if reader.records else ""
    return EpisodeList(ref, task, _milestones(task, lines), lines, STATE_KEY in reader.schema)


@lru_cache(maxsize=8)
def _evaluated(ref: ArtifactRef, folder: Path, task: str, has_examples: bool) -> EpisodeList:
    reader = EpisodeReader(folder / EXAMPLES) if has_examples else None
    records = reader.records if reader else ()
    places = {record.seed: place for place, record in enumerate(records)}
    lines = tuple(
        Line(
            number=row.episode,
            seed=row.seed,
            outcome=row.outcome,
            length=row.length,
            parts_assembled=row.parts_assembled,
            milestones=row.milestones,
            place=places.get(row.seed),
        )
        for row in read_evaluation(folder)
    )
    task = records[0].task if records else task
    has_states = reader is not None and STATE_KEY in reader.schema
    return EpisodeList(ref, task, _milestones(task, lines), lines, has_states)


def _is_correctable(record: EpisodeRecord) -> bool:
    try:
        require_correctable(record)
    except (NotCorrectable, EvaluationOnly):
        return False
    return True


def _milestones(task: str, lines: Sequence[Line]) -> tuple[str, ...]:
    """Of the task, or if that is not known here, those that were reached."""
    try:
        return get_task(task).milestones
    except ConfigError:
        return tuple(dict.fromkeys(name for line in lines for name in line.milestones))
