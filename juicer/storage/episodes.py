"""Episodes on disk: a Zarr v3 group of time-major arrays, and a Parquet row an episode.

``episodes.zarr`` holds ``data/<name>`` (all steps of all episodes, one after another), ``final/<name>`` (one entry
an episode) and ``meta/episode_ends`` (index one past the last step of each episode); its attributes say what the
arrays are. ``episodes.parquet`` holds the records.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import zarr
from numpy.typing import NDArray

from juicer.episode import SIMULATOR, ArraySpec, Episode, EpisodeRecord, Outcome, Schema, Source, require_state
from juicer.errors import ArtifactError, InvalidEpisode, NothingLeft, did_you_mean
from juicer.storage.arrays import Array, GrowingArray, StoredArrays, create_group, write_ends
from juicer.storage.columns import ColumnReader
from juicer.storage.tables import MILESTONES, read_table, write_table
from juicer.text import printable

SCHEMA_VERSION = 3
"""The first had the arrays of :data:`juicer.episode.SIMULATOR` and no ids, the second neither corrections nor
shifts. Both are read."""
CHUNK_BYTES = 2**22
MOST_CHUNK_STEPS = 2048
"""A chunk holds as many steps as there is room for, so that an episode touches few chunks of any array; and no more
steps than that, so that reading an episode does not unpack all others."""

_RECORDS = pa.schema(
    {
        "episode_id": pa.string(),
        "length": pa.int32(),
        "source": pa.string(),
        "task": pa.string(),
        "randomness": pa.string(),
        "seed": pa.int64(),
        "outcome": pa.string(),
        "parts_assembled": pa.int32(),
        "milestones": MILESTONES,
        "policy": pa.string(),
        "parent": pa.string(),
        "parent_step": pa.int32(),
        "critical_state": pa.int32(),
        "device": pa.string(),
        "operator": pa.string(),
        "recorded_at": pa.string(),
        "log": pa.string(),
        "shift": pa.string(),
    }
)

_ADDED = ("episode_id", "operator", "recorded_at", "log")
_SECOND_RECORDS = pa.schema([field for field in _RECORDS if field.name not in ("parent_step", "shift")])
_FIRST_RECORDS = pa.schema(
    [pa.field("episode", pa.int32()), *(field for field in _SECOND_RECORDS if field.name not in _ADDED)]
)
_OLDER = {1: _FIRST_RECORDS, 2: _SECOND_RECORDS}
_OPTIONAL = ("policy", "parent", "parent_step", "critical_state", "device", "operator", "recorded_at", "log", "shift")

_MANY = 10_000
"""Ids among which no similar one is looked for."""


def write_episodes(
    folder: Path, episodes: Iterable[Episode], attributes: Mapping[str, Any], *, may_be_empty: bool = False
) -> int:
    """Write episodes one at a time; memory holds a few chunks, however many episodes there are.

    Args:
        folder: Existing folder that gets ``episodes.zarr`` and ``episodes.parquet``.
        episodes: In the order in which they get their indices.
        attributes: JSON facts stored with the Zarr group.
        may_be_empty: Whether no episode at all is worth keeping too: as the result of a long search.

    Returns:
        Number of episodes written.

    Raises:
        NothingLeft: If there is no episode, unless there may be none.
        InvalidEpisode: If an episode's arrays are not those of the first, or an episode is there twice.
    """
    group = create_group(folder / "episodes.zarr")
    schema = Schema(())
    appenders: dict[str, GrowingArray] = {}
    rows: dict[str, dict[str, Any]] = {}
    for episode in episodes:
        if not rows:
            schema = episode.schema.sized(episode.steps)
            appenders = _appenders(group, schema)
        identity = episode.record.episode_id
        if identity in rows:
            raise InvalidEpisode(f"episode {identity} is there twice; an artifact holds every episode once")
        if episode.schema.names() != schema.names():
            raise InvalidEpisode(
                f"episode {identity} has the arrays {list(episode.schema.names())}, "
                f"but the episodes before have {list(schema.names())}"
            )
        for name, values in episode.steps.items():
            appenders[f"data/{name}"].append(np.asarray(values))
        for name, values in episode.final.items():
            appenders[f"final/{name}"].append(np.asarray(values)[None])
        rows[identity] = {"length": len(episode), **asdict(episode.record)}
    if not rows and not may_be_empty:
        raise NothingLeft("there is no episode to store")
    for appender in appenders.values():
        appender.flush()
    write_ends(group, [row["length"] for row in rows.values()])
    group.attrs.update({**attributes, "schema_version": SCHEMA_VERSION, "arrays": schema.to_json()})
    write_table(folder / "episodes.parquet", _RECORDS, rows.values())
    return len(rows)


class EpisodeReader:
    """Read access to stored episodes; arrays are read from disk when asked for.

    Attributes:
        folder: Where they are.
        attributes: The facts stored with the group.
        schema: What the arrays are, joined columns included; empty if there is no episode and no column.
        episode_ends: ``(N,)`` index one past the last step of each episode, in the time-major arrays.
        lengths: ``(N,)`` number of steps of each episode.
    """

    def __init__(self, folder: Path, columns: Sequence[Path] = ()) -> None:
        """Open the episodes of an artifact.

        Args:
            folder: Its folder.
            columns: Folders of column artifacts derived from it; their arrays are read as if they were its own.

        Raises:
            ArtifactError: If the folder holds no episodes that juicer wrote, or those of another schema version, or if
                columns are of other episodes.
        """
        self.folder = folder
        self._arrays = StoredArrays(folder / "episodes.zarr", "episodes")
        self.attributes: dict[str, Any] = self._arrays.attributes
        self._version = self.attributes.pop("schema_version", None)
        self.schema = self._read_schema()
        self.episode_ends: NDArray[np.int64] = self._arrays.read_ends()
        self.lengths: NDArray[np.int64] = np.diff(self.episode_ends, prepend=0)
        self._columns: dict[str, ColumnReader] = {}
        for each in columns:
            self._join(ColumnReader(each))

    def __len__(self) -> int:
        """Number of episodes."""
        return len(self.episode_ends)

    @cached_property
    def records(self) -> list[EpisodeRecord]:
        """Facts about every episode."""
        names = [field.name for field in fields(EpisodeRecord)]
        is_first = self._version == 1
        optional = _ADDED + _OPTIONAL if is_first else _OPTIONAL
        rows = read_table(self.folder / "episodes.parquet", _RECORDS, optional, _OLDER.get(self._version))
        if [row["length"] for row in rows] != self.lengths.tolist():
            raise self._arrays.refusal("its table and its arrays are of different episodes")
        try:
            records = [
                EpisodeRecord(
                    **{name: row[name] for name in names}
                    | {"source": Source(row["source"]), "outcome": Outcome(row["outcome"])}
                )
                for row in rows
            ]
        except ValueError as error:
            raise self._arrays.refusal(printable(error)) from None
        if is_first:
            records = [self._episode(index, replace(r, episode_id="")).record for index, r in enumerate(records)]
        if len({record.episode_id for record in records}) < len(records):
            raise self._arrays.refusal("two of its episodes have one id")
        return records

    @cached_property
    def ids(self) -> dict[str, int]:
        """Number of each episode by its id, in order."""
        return {record.episode_id: index for index, record in enumerate(self.records)}

    def find(self, episode_id: str) -> int:
        """Number of the episode of an id.

        Raises:
            ArtifactError: If there is none.
        """
        if episode_id not in self.ids:
            known = did_you_mean(episode_id, self.ids) if len(self.ids) < _MANY else ""
            raise ArtifactError(f"'{self.folder}' holds no episode {printable(episode_id)}{known}")
        return self.ids[episode_id]

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Whether all columns that were joined have entries for each episode ``(N,)``."""
        covered = np.ones(len(self), bool)
        for columns in self._columns.values():
            covered &= columns.covered
        return covered

    def spans(self, indices: Iterable[int]) -> list[slice]:
        """Steps of some episodes, in their order; those that lie side by side are one span."""
        spans: list[slice] = []
        for index in indices:
            end = int(self.episode_ends[index])
            start = end - int(self.lengths[index])
            if spans and spans[-1].stop == start:
                start = spans.pop().start
            spans.append(slice(start, end))
        return spans

    def require_state(self) -> None:
        """Refuse episodes without simulator states before anything is begun that needs them.

        Raises:
            StateMissing: If they have none.
        """
        if len(self):
            require_state(self.schema, f"the data in '{self.folder}'")

    def read(self, index: int) -> Episode:
        """One episode; negative indices count from the end.

        Raises:
            IndexError: If there is no such episode.
        """
        index = range(len(self))[index]
        return self._episode(index, self.records[index])

    def _episode(self, index: int, record: EpisodeRecord) -> Episode:
        end = int(self.episode_ends[index])
        span = slice(end - int(self.lengths[index]), end)
        return Episode(
            record=record,
            steps={name: self._steps(name, span) for name in self.schema.names()},
            final={
                name: self._arrays.read(f"final/{name}", self.schema[name], len(self), index)
                for name in self.schema.ends
            },
            schema=self.schema,
        )

    def steps(self, name: str, span: slice = slice(None)) -> Array:
        """All steps of all episodes, ``(sum of lengths, ...)``, of an array of the schema; or some of them.

        Args:
            name: Name of the array.
            span: Which steps, counted over all episodes.

        Raises:
            NothingLeft: If there is no episode: nobody knows the shape of its steps.
            ArtifactError: If the episodes have no such array.
        """
        if not len(self):
            raise NothingLeft(f"the episodes in '{self.folder}' are none")
        if name not in self.schema:
            known = did_you_mean(name, self.schema.names())
            raise ArtifactError(f"the episodes in '{self.folder}' have no array '{printable(name)}'{known}")
        return self._steps(name, span)

    def _read_schema(self) -> Schema:
        if self._version == 1:
            return SIMULATOR
        if self._version not in (*_OLDER, SCHEMA_VERSION):
            raise ArtifactError(
                f"episodes in '{self.folder}' have schema version {printable(self._version)}; "
                f"this juicer reads {SCHEMA_VERSION}"
            )
        try:
            return Schema.from_json(self.attributes.pop("arrays", None))
        except ValueError as error:
            raise self._arrays.refusal(printable(error)) from None

    def _steps(self, name: str, span: slice) -> Array:
        if name in self._columns:
            return self._columns[name].steps(name, span)
        return self._arrays.read(f"data/{name}", self.schema[name], int(self.episode_ends[-1]), span)

    def _join(self, columns: ColumnReader) -> None:
        columns.check_belong(self.folder, self.episode_ends)
        for spec in columns.schema:
            if spec.name in self.schema:
                raise ArtifactError(
                    f"the columns in '{columns.folder}' have an array '{spec.name}', and so have the episodes in "
                    f"'{self.folder}' or other columns of them; leave one out"
                )
            self._columns[spec.name] = columns
        self.schema = self.schema.extended(*columns.schema)


def _appenders(group: zarr.Group, schema: Schema) -> dict[str, GrowingArray]:
    paths = [(f"data/{name}", schema[name]) for name in schema.names()]
    paths += [(f"final/{name}", schema[name]) for name in schema.ends]
    return {path: GrowingArray(group, path, spec, _chunk(spec)) for path, spec in paths}


def _chunk(spec: ArraySpec) -> int:
    """Steps in a chunk."""
    step_bytes = math.prod(size or 0 for size in spec.shape) * np.dtype(spec.dtype).itemsize
    return min(MOST_CHUNK_STEPS, max(1, CHUNK_BYTES // step_bytes))
