"""Episodes on disk: a Zarr v3 group of time-major arrays, and a Parquet row an episode.

``episodes.zarr`` holds ``data/<key>`` (all steps of all episodes, one after another), ``final/<key>`` (one entry
an episode) and ``meta/episode_ends`` (index one past the last step of each episode). ``episodes.parquet`` holds
the records.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import zarr
from numpy.typing import NDArray
from zarr.codecs import BloscCodec

from juicer.episode import FINAL_KEYS, STEP_DTYPES, Episode, EpisodeRecord, Outcome, Source
from juicer.errors import ArtifactError, InvalidEpisode, NothingLeft
from juicer.storage.tables import MILESTONES, read_table, write_table
from juicer.text import printable

SCHEMA_VERSION = 1
CHUNK_STEPS = 2048
"""Steps a chunk: a few megabytes for the simulator state, so that an episode touches one or two chunks an array."""

MOST_BYTES = 2**36
MOST_CHUNK_BYTES = 2**30
MOST_METADATA_BYTES = 2**24
"""Of an array, of a chunk of one and of the group's description: far more than juicer writes."""

_RECORDS = pa.schema(
    {
        "episode": pa.int32(),
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
    }
)

_OPTIONAL = ("policy", "parent", "critical_state", "device")

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
        InvalidEpisode: If an episode's arrays differ in shape from those of the first.
    """
    group = zarr.open_group(folder / "episodes.zarr", mode="w-", zarr_format=3)
    appenders: dict[str, _Appender] = {}
    rows: list[dict[str, Any]] = []
    for index, episode in enumerate(episodes):
        arrays = {f"data/{key}": np.asarray(episode.steps[key]) for key in STEP_DTYPES}
        arrays |= {f"final/{key}": np.asarray(episode.final[key])[None] for key in FINAL_KEYS}
        for path, values in arrays.items():
            if index == 0:
                appenders[path] = _Appender(group, path, values.shape[1:])
            appenders[path].append(values)
        rows.append({"episode": index, "length": len(episode), **asdict(episode.record)})
    if not rows and not may_be_empty:
        raise NothingLeft("there is no episode to store")
    for appender in appenders.values():
        appender.flush()
    ends = np.cumsum([row["length"] for row in rows], dtype=np.int64)
    group.create_array("meta/episode_ends", data=ends, chunks=(max(1, len(ends)),))
    group.attrs.update({**attributes, "schema_version": SCHEMA_VERSION})
    write_table(folder / "episodes.parquet", _RECORDS, rows)
    return len(rows)


class EpisodeReader:
    """Read access to stored episodes; arrays are read from disk when asked for.

    Attributes:
        attributes: The facts stored with the group.
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
        if (version := self.attributes.pop("schema_version", None)) != SCHEMA_VERSION:
            raise ArtifactError(
                f"episodes in '{folder}' have schema version {printable(version)}; this juicer reads {SCHEMA_VERSION}"
            )
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
        rows = read_table(self._folder / "episodes.parquet", _RECORDS, _OPTIONAL)
        if [row["length"] for row in rows] != self.lengths.tolist():
            raise self._refusal("its table and its arrays are of different episodes")
        try:
            return [
                EpisodeRecord(
                    **{name: row[name] for name in names}
                    | {"source": Source(row["source"]), "outcome": Outcome(row["outcome"])}
                )
                for row in rows
            ]
        except ValueError as error:
            raise self._refusal(printable(error)) from None

    def read(self, index: int) -> Episode:
        """One episode; negative indices count from the end.

        Raises:
            IndexError: If there is no such episode.
        """
        index = range(len(self))[index]
        end = int(self.episode_ends[index])
        span = slice(end - int(self.lengths[index]), end)
        return Episode(
            record=self.records[index],
            steps={key: self._read(f"data/{key}", span) for key in STEP_DTYPES},
            final={key: self._read(f"final/{key}", index) for key in FINAL_KEYS},
        )

    def steps(self, key: str) -> Array:
        """All steps of all episodes, ``(sum of lengths, ...)``; ``key`` is one of ``STEP_DTYPES``.

        Raises:
            NothingLeft: If there is no episode: nobody knows the shape of its steps.
        """
        if not len(self):
            raise NothingLeft(f"the episodes in '{self._folder}' are none")
        return self._read(f"data/{key}", slice(None))

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
        if array.dtype.kind not in "if" or array.nbytes > MOST_BYTES or chunk > MOST_CHUNK_BYTES:
            raise self._refusal(f"array '{path}' has an absurd size or type")
        kind, _, key = path.partition("/")
        if kind == "data" and (array.shape[0] != self.episode_ends[-1] or array.dtype != STEP_DTYPES[key]):
            raise self._refusal(f"array '{path}' is not one of theirs")
        if kind == "final" and (array.shape[0] != len(self) or array.dtype != STEP_DTYPES[key]):
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


class _Appender:
    """Growing array that touches the disk a whole number of chunks at a time."""

    def __init__(self, group: zarr.Group, path: str, shape: tuple[int, ...]) -> None:
        self._key = path.rpartition("/")[2]
        self._shape = shape
        self._pending: list[Array] = []
        self._array = group.create_array(
            path,
            shape=(0, *shape),
            chunks=(CHUNK_STEPS, *shape),
            dtype=np.dtype(STEP_DTYPES[self._key]),
            compressors=BloscCodec(cname="zstd", clevel=5, shuffle="shuffle"),
        )

    def append(self, values: Array) -> None:
        if values.shape[1:] != self._shape:
            raise InvalidEpisode(
                f"array '{self._key}' has shape {values.shape[1:]} a step but {self._shape} in the episodes before"
            )
        self._pending.append(values.astype(self._array.dtype))
        if sum(map(len, self._pending)) >= CHUNK_STEPS:
            pending = np.concatenate(self._pending)
            full = len(pending) // CHUNK_STEPS * CHUNK_STEPS
            self._array.append(pending[:full])
            self._pending = [pending[full:]]

    def flush(self) -> None:
        """Write what does not fill a chunk."""
        if rest := [values for values in self._pending if len(values)]:
            self._array.append(np.concatenate(rest))
