"""Which episodes are learned from, and how much each counts: the rows of a dataset."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Annotated

from pydantic import Field

from juicer.config import StrictConfig
from juicer.episode import EpisodeRecord, Source
from juicer.errors import ArtifactError, NothingLeft
from juicer.shifts import require_unshifted
from juicer.storage.dataset import DatasetRow
from juicer.tasks.task_name import TaskName

MOST_TASKS = 1000
MOST_WEIGHT = 1e6
Weight = Annotated[float, Field(ge=1 / MOST_WEIGHT, le=MOST_WEIGHT)]
SYNTHETIC = (Source.AUGMENTATION, Source.ROLLOUT)
"""Sources of what no operator has done."""


class DatasetConfig(StrictConfig):
    """What is learned from, of all that there is; by default everything, and every step as often as any other."""

    sources: tuple[Source, ...] | None = Field(
        default=None,
        min_length=1,
        max_length=len(Source),
        description="teleop, augmentation, rollout, correction; all if empty",
    )
    tasks: tuple[TaskName, ...] | None = Field(
        default=None, min_length=1, max_length=MOST_TASKS, description="assembly tasks; all if empty"
    )
    weights: dict[Source, Weight] = Field(
        default={},
        max_length=len(Source),
        description="by source, how often a step is learned from as compared with others; 1 if left out. "
        "To leave a source out, leave it out of sources",
    )
    synthetic_share: float | None = Field(
        default=None,
        gt=0,
        lt=1,
        description="share of corrective episodes and rollouts, in steps, reached by weights; of what is learned it is "
        "smaller where short episodes lose more steps to windows than long ones. If empty, their share of all steps",
    )


@dataclass(frozen=True)
class GivenEpisodes:
    """Episodes of one artifact that may be learned from.

    Attributes:
        artifact: Its id.
        records: Facts about each of its episodes.
        lengths: Steps of each.
        columns: Ids of the artifacts with columns of them.
    """

    artifact: str
    records: Sequence[EpisodeRecord]
    lengths: Sequence[int]
    columns: tuple[str, ...] = ()


def mix(given: Sequence[GivenEpisodes], judged: Mapping[str, bool], config: DatasetConfig) -> list[DatasetRow]:
    """Rows of a dataset, in the order of what is given.

    Args:
        given: All episodes that there are.
        judged: By its id, whether an episode is kept; one that nobody judged is.
        config: Which of them are taken, and their weights.

    Raises:
        NothingLeft: If an artifact gives nothing, or all together do.
        ArtifactError: If an episode is in two artifacts, or one that was judged is in none.
        EvaluationOnly: If one was made under a shift.
    """
    families = _families(given)
    if missing := next((identity for identity in judged if identity not in families), None):
        raise ArtifactError(f"a selection judges episode {missing}, which is in none of the episodes given")
    rows: list[DatasetRow] = []
    lengths: dict[str, int] = {}
    for each in given:
        require_unshifted(each.records, f"episodes/{each.artifact}")
        kept = [
            (record, length)
            for record, length in zip(each.records, each.lengths, strict=True)
            if judged.get(record.episode_id, True)
        ]
        if not kept:
            raise NothingLeft(f"episodes/{each.artifact} holds nothing to learn from; leave it out")
        for record, length in kept:
            if _is_chosen(record, config):
                rows.append(_row(each, record, families[record.episode_id], config))
                lengths[record.episode_id] = length
    if not rows:
        raise NothingLeft("no episode is of the sources and tasks that the dataset is to be made of")
    return rows if config.synthetic_share is None else list(_shared(rows, lengths, config.synthetic_share))


def _is_chosen(record: EpisodeRecord, config: DatasetConfig) -> bool:
    return (config.sources is None or record.source in config.sources) and (
        config.tasks is None or record.task in config.tasks
    )


def _row(given: GivenEpisodes, record: EpisodeRecord, family: str, config: DatasetConfig) -> DatasetRow:
    return DatasetRow(
        episodes=given.artifact,
        episode_id=record.episode_id,
        source=record.source,
        task=record.task,
        family=family,
        weight=config.weights.get(record.source, 1.0),
        columns=given.columns,
    )


def _families(given: Sequence[GivenEpisodes]) -> dict[str, str]:
    """Family of each episode: the place among the inputs of the episode that it was grown from."""
    places: dict[str, str] = {}
    for position, each in enumerate(given):
        for number, record in enumerate(each.records):
            if record.episode_id in places:
                raise ArtifactError(
                    f"episode {record.episode_id} of episodes/{each.artifact} is in other episodes given, too; "
                    "leave one of them out"
                )
            places[record.episode_id] = f"{position}/{number}"
    parents = {
        record.episode_id: record.parent
        for record in chain.from_iterable(each.records for each in given)
        if record.parent
    }
    roots = {identity: _root(identity, parents) for identity in places}
    return {identity: places.get(root, root) for identity, root in roots.items()}


def _root(identity: str, parents: Mapping[str, str]) -> str:
    """What an episode was grown from in the end."""
    # Whoever composes episodes that grow from each other must not keep us for ever.
    seen: set[str] = set()
    while identity in parents and identity not in seen:
        seen.add(identity)
        identity = parents[identity]
    return identity


def _shared(rows: Sequence[DatasetRow], lengths: Mapping[str, int], share: float) -> Iterator[DatasetRow]:
    """The rows with weights at which synthetic ones have a share of the steps; as they are if all are of one sort."""
    synthetic = sum(row.weight * lengths[row.episode_id] for row in rows if row.source in SYNTHETIC)
    others = sum(row.weight * lengths[row.episode_id] for row in rows if row.source not in SYNTHETIC)
    factor = share / (1 - share) * others / synthetic if synthetic and others else 1.0
    for row in rows:
        yield replace(row, weight=row.weight * factor) if row.source in SYNTHETIC else row
