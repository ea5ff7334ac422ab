"""Episodes on disk: a Zarr v3 group of time-major arrays, and a Parquet row an episode.

``episodes.zarr`` holds ``data/<name>`` (all steps of all episodes, one after another), ``final/<name>`` (one entry
an episode) and ``meta/episode_ends`` (index one past the last step of each episode); its attributes say what the
arrays are. ``episodes.parquet`` holds the records.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import zarr
from numpy.typing import NDArray
from zarr.codecs import BloscCodec

from juicer.episode import SIMULATOR, ArraySpec, Episode, EpisodeRecord, Outcome, Schema, Source, require_state
from juicer.errors import ArtifactError, InvalidEpisode, NothingLeft, did_you_mean
from juicer.storage.tables import MILESTONES, read_table, write_table
from juicer.text import printable

SCHEMA_VERSION = 2
"""The first had the arrays of :data:`juicer.episode.SIMULATOR` and no ids; it is still read."""
CHUNK_BYTES = 2**22
MOST_CHUNK_STEPS = 2048
"""A chunk holds as many steps as there is room for, so that an episode touches few chunks of any array; and no more
steps than that, so that reading an episode does not unpack all others."""

MOST_BYTES = 2**36
MOST_CHUNK_BYTES = 2**30
MOST_METADATA_BYTES = 2**24
"""Of an array, of a chunk of one and of the group's description: far more than juicer writes."""

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
        "critical_state": pa.int32(),
        "device": pa.string(),
        "operator": pa.string(),
        "recorded_at": pa.string(),
        "log": pa.string(),
    }
)

_ADDED = ("episode_id", "operator", "recorded_at", "log")
_FIRST_RECORDS = pa.schema(
    [pa.field("episode", pa.int32()), *(field for field in _RECORDS if field.name not in _ADDED)]
)
_OPTIONAL = ("policy", "parent", "critical_state", "device", "operator", "recorded_at", "log")

_MANY = 10_000
"""Ids among which no similar one is looked for."""

Array = NDArray[Any]


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
    group = zarr.open_group(folder / "episodes.zarr", mode="w-", zarr_format=3)
    schema = Schema(())
    appenders: dict[str, _Appender] = {}
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
    ends = np.cumsum([row["length"] for row in rows.values()], dtype=np.int64)
    group.create_array("meta/episode_ends", data=ends, chunks=(max(1, len(ends)),))
    group.attrs.update({**attributes, "schema_version": SCHEMA_VERSION, "arrays": schema.to_json()})
    write_table(folder / "episodes.parquet", _RECORDS, rows.values())
    return len(rows)


class EpisodeReader:
    """Read access to stored episodes; arrays are read from disk when asked for.

    Attributes:
        attributes: The facts stored with the group.
        schema: What the arrays are; empty if there is no episode.
        episode_ends: ``(N,)`` index one past the last step of each episode, in the time-major arrays.
        lengths: ``(N,)`` number of steps of each episode.
    """

    def __init__(self, folder: Path) -> None:
        """Open the episodes of an artifact.

        Raises:
            ArtifactError: If the folder holds no episodes that juicer wrote, or those of another schema version.
        """
        self._folder = folder
        self._group = _open_group(folder / "episodes.zarr")
        try:
            self.attributes: dict[str, Any] = dict(self._group.attrs)
        except (TypeError, ValueError):
            self.attributes = {}
        self._version = self.attributes.pop("schema_version", None)
        self.schema = self._read_schema()
        self.episode_ends: NDArray[np.int64] = self._read("meta/episode_ends", slice(None))
        self.lengths: NDArray[np.int64] = np.diff(self.episode_ends, prepend=0)
        if self.episode_ends.ndim != 1 or self.episode_ends.dtype != np.int64 or np.any(self.lengths < 1):
            raise self._refusal("its episodes have no ends")

    def __len__(self) -> int:
        """Number of episodes."""
        return len(self.episode_ends)

    @cached_property
    def records(self) -> list[EpisodeRecord]:
        """Facts about every episode."""
        names = [field.name for field in fields(EpisodeRecord)]
        is_first = self._version == 1
        optional = _ADDED + _OPTIONAL if is_first else _OPTIONAL
        rows = read_table(self._folder / "episodes.parquet", _RECORDS, optional, _FIRST_RECORDS if is_first else None)
        if [row["length"] for row in rows] != self.lengths.tolist():
            raise self._refusal("its table and its arrays are of different episodes")
        try:
            records = [
                EpisodeRecord(
                    **{name: row[name] for name in names}
                    | {"source": Source(row["source"]), "outcome": Outcome(row["outcome"])}
                )
                for row in rows
            ]
        except ValueError as error:
            raise self._refusal(printable(error)) from None
        if is_first:
            records = [self._episode(index, replace(r, episode_id="")).record for index, r in enumerate(records)]
        if len({record.episode_id for record in records}) < len(records):
            raise self._refusal("two of its episodes have one id")
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
            raise ArtifactError(f"'{self._folder}' holds no episode {printable(episode_id)}{known}")
        return self.ids[episode_id]

    def require_state(self) -> None:
        """Refuse episodes without simulator states before anything is begun that needs them.

        Raises:
            StateMissing: If they have none.
        """
        if len(self):
            require_state(self.schema, f"the data in '{self._folder}'")

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
            steps={name: self._read(f"data/{name}", span) for name in self.schema.names()},
            final={name: self._read(f"final/{name}", index) for name in self.schema.ends},
            schema=self.schema,
        )

    def steps(self, name: str) -> Array:
        """All steps of all episodes, ``(sum of lengths, ...)``, of an array of the schema.

        Raises:
            NothingLeft: If there is no episode: nobody knows the shape of its steps.
            ArtifactError: If the episodes have no such array.
        """
        if not len(self):
            raise NothingLeft(f"the episodes in '{self._folder}' are none")
        if name not in self.schema:
            known = did_you_mean(name, self.schema.names())
            raise ArtifactError(f"the episodes in '{self._folder}' have no array '{printable(name)}'{known}")
        return self._read(f"data/{name}", slice(None))

    def _read_schema(self) -> Schema:
        if self._version == 1:
            return SIMULATOR
        if self._version != SCHEMA_VERSION:
            raise ArtifactError(
                f"episodes in '{self._folder}' have schema version {printable(self._version)}; "
                f"this juicer reads {SCHEMA_VERSION}"
            )
        try:
            return Schema.from_json(self.attributes.pop("arrays", None))
        except ValueError as error:
            raise self._refusal(printable(error)) from None

    def _read(self, path: str, selection: slice | int) -> Array:
        """Part of an array, whose size and type are looked at before memory is taken for it."""
        array = self._find(path)
        try:
            return np.asarray(array[selection])
        # Each codec has its own errors for content that is none of its own.
        except Exception as error:
            raise self._refusal(f"array '{path}' cannot be unpacked: {printable(error)}") from None

    def _find(self, path: str) -> zarr.Array[Any]:
        try:
            array = self._group[path]
        except Exception as error:
            raise self._refusal(f"array '{path}' cannot be opened: {printable(error)}") from None
        if not isinstance(array, zarr.Array) or not array.shape:
            raise self._refusal(f"'{path}' is no array of theirs")
        chunk = array.dtype.itemsize * math.prod(array.chunks)
        if array.dtype.kind not in "biuf" or array.nbytes > MOST_BYTES or chunk > MOST_CHUNK_BYTES:
            raise self._refusal(f"array '{path}' has an absurd size or type")
        kind, _, name = path.partition("/")
        if kind != "meta":
            length = int(self.episode_ends[-1]) if kind == "data" else len(self)
            if array.shape[0] != length or not self.schema[name].fits(array.shape[1:], array.dtype):
                raise self._refusal(f"array '{path}' is not one of theirs")
        return array

    def _refusal(self, reason: str) -> ArtifactError:
        return ArtifactError(f"episodes in '{self._folder}' were not written by juicer: {reason}")


def _open_group(path: Path) -> zarr.Group:
    try:
        if (path / "zarr.json").stat().st_size > MOST_METADATA_BYTES:
            raise ArtifactError(f"'{path}' has a description of absurd size")
        return zarr.open_group(path, mode="r", zarr_format=3)
    except (FileNotFoundError, NotADirectoryError):
        raise ArtifactError(f"'{path.parent}' holds no episodes") from None
    except ArtifactError:
        raise
    # What the library raises for a description that is none is not written down.
    except Exception as error:
        raise ArtifactError(f"'{path.parent}' holds no episodes that juicer wrote: {printable(error)}") from None


def _appenders(group: zarr.Group, schema: Schema) -> dict[str, _Appender]:
    paths = [(f"data/{name}", name) for name in schema.names()] + [(f"final/{name}", name) for name in schema.ends]
    return {path: _Appender(group, path, schema[name]) for path, name in paths}


class _Appender:
    """Growing array that touches the disk a whole number of chunks at a time."""

    def __init__(self, group: zarr.Group, path: str, spec: ArraySpec) -> None:
        self._name = spec.name
        self._shape = tuple(size or 0 for size in spec.shape)
        dtype = np.dtype(spec.dtype)
        self._chunk = min(MOST_CHUNK_STEPS, max(1, CHUNK_BYTES // (math.prod(self._shape) * dtype.itemsize)))
        self._pending: list[Array] = []
        self._array = group.create_array(
            path,
            shape=(0, *self._shape),
            chunks=(self._chunk, *self._shape),
            dtype=dtype,
            compressors=BloscCodec(cname="zstd", clevel=5, shuffle="shuffle"),
        )

    def append(self, values: Array) -> None:
        if (values.shape[1:], values.dtype) != (self._shape, self._array.dtype):
            raise InvalidEpisode(
                f"array '{self._name}' has shape {values.shape[1:]} a step but {self._shape} in the episodes before"
            )
        # A copy: the end of an episode is often a view that would keep all of it in memory.
        self._pending.append(values.copy())
        if sum(map(len, self._pending)) >= self._chunk:
            pending = np.concatenate(self._pending)
            full = len(pending) // self._chunk * self._chunk
            self._array.append(pending[:full])
            self._pending = [pending[full:]]

    def flush(self) -> None:
        """Write what does not fill a chunk."""
        if rest := [values for values in self._pending if len(values)]:
            self._array.append(np.concatenate(rest))
