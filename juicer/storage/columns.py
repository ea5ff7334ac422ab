"""Columns on disk: arrays derived from the episodes of one artifact, such as the images of one camera.

``columns.zarr`` holds ``data/<name>``, an entry for every step of the episodes that it covers, one after another, and
``meta/episode_ends``, a copy of theirs; its attributes say what the arrays are, which artifact's episodes they belong
to, which of these are covered, and what drew images. Chunks are small, for whoever looks at a step unpacks little, and
share files, lest there be thousands.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from juicer.episode import ArraySpec, Role, Schema
from juicer.errors import ArtifactError, InvalidEpisode, did_you_mean
from juicer.storage.arrays import Array, GrowingArray, StoredArrays, create_group, write_ends
from juicer.text import printable

SCHEMA_VERSION = 1
COLUMNS = "columns.zarr"
DRAWN_BY = "drawn_by"
"""Name in a summary of what drew images: a list, in the words of OpenGL platforms. Each draws the same scene a little
differently."""
CHUNK_BYTES = 2**15
CHUNK_STEPS = 8
"""What is unpacked to read one step: so many bytes of a feature, or at least so many steps of images, which repeat each
other: of the cameras' images this halves the size, reads all of them five times as fast, and takes for one of them
little longer than if it were alone (docs/results/images.md)."""
SHARD_BYTES = 2**25
"""A file: hundreds of images."""


def write_columns(
    folder: Path,
    specs: Sequence[ArraySpec],
    episodes: Iterable[Mapping[str, Array]],
    *,
    artifact: str,
    episode_ends: NDArray[np.int64],
    covered: NDArray[np.bool_] | None = None,
    drawn_by: Iterable[str] = (),
) -> None:
    """Write arrays derived from episodes of an artifact; memory holds an episode and a few chunks.

    Args:
        folder: Existing folder that gets ``columns.zarr``.
        specs: What the arrays are: derived ones, every size known.
        episodes: Arrays ``(T, ...)`` by name for each episode covered, in the order of the artifact.
        artifact: Id of the artifact of the episodes.
        episode_ends: Its ``(N,)`` index one past the last step of each episode.
        covered: Which of its episodes they are derived from ``(N,)``; all if None.
        drawn_by: What drew the images that they are, or come from, in the words of OpenGL platforms.

    Raises:
        InvalidEpisode: If an array does not fit its specification or its episode, or an episode is missing.
    """
    schema = Schema(tuple(specs))
    if not specs or schema.names(Role.DERIVED) != schema.names():
        raise InvalidEpisode("columns are arrays that were derived from episodes: give at least one, of this role only")
    group = create_group(folder / COLUMNS)
    arrays = {spec.name: _array(group, spec) for spec in specs}
    lengths = np.diff(episode_ends, prepend=0)
    covered = np.ones(len(lengths), bool) if covered is None else covered
    numbers = np.flatnonzero(covered).tolist()
    given = -1
    for given, columns in enumerate(episodes):
        if given >= len(numbers):
            raise InvalidEpisode(f"columns are given for more than {_share(covered)} episodes of {artifact}")
        number = numbers[given]
        _check(columns, arrays, lengths[number], f"episode {number} of {artifact}")
        for name, values in columns.items():
            arrays[name].append(values)
    if given + 1 < len(numbers):
        raise InvalidEpisode(f"columns are given for {given + 1} of {_share(covered)} episodes of {artifact}")
    for array in arrays.values():
        array.flush()
    write_ends(group, lengths.tolist())
    group.attrs.update(
        {
            "schema_version": SCHEMA_VERSION,
            "episodes": artifact,
            "arrays": schema.to_json(),
            "covered": covered.tolist(),
            DRAWN_BY: sorted(set(drawn_by)),
        }
    )


def _check(columns: Mapping[str, Array], names: Iterable[str], length: int, episode: str) -> None:
    """Refuse what cannot be the columns of an episode of some length."""
    if set(columns) != set(names):
        raise InvalidEpisode(f"{episode} needs the columns {sorted(names)}, got {sorted(columns)}")
    for name, values in columns.items():
        if len(values) != length:
            raise InvalidEpisode(f"column '{name}' has {len(values)} steps in {episode}, which has {length}")
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise InvalidEpisode(f"column '{name}' holds NaN or infinite values in {episode}")


def stored_bytes(spec: ArraySpec, values: Array) -> int:
    """Bytes that some steps ``(T, ...)`` of a column take on a disk."""
    group = zarr.open_group(zarr.storage.MemoryStore(), mode="w", zarr_format=3)
    array = _array(group, spec)
    array.append(values)
    array.flush()
    return array.nbytes_stored


class ColumnReader:
    """Read access to stored columns; arrays are read from disk when asked for.

    Attributes:
        folder: Where they are.
        artifact: Id of the artifact of the episodes that they belong to.
        schema: What the arrays are.
        episode_ends: ``(N,)`` index one past the last step of each of these episodes.
        covered: Whether they have entries for each of these ``(N,)``.
        drawn_by: What drew the images that they are, or come from, in the words of OpenGL platforms.
    """

    def __init__(self, folder: Path) -> None:
        """Open the columns of an artifact.

        Raises:
            ArtifactError: If the folder holds no columns that juicer wrote, or those of another schema version.
        """
        self.folder = folder
        self._arrays = StoredArrays(folder / COLUMNS, "columns")
        attributes: dict[str, Any] = self._arrays.attributes
        if (version := attributes.get("schema_version")) != SCHEMA_VERSION:
            raise ArtifactError(
                f"columns in '{folder}' have schema version {printable(version)}; this juicer reads {SCHEMA_VERSION}"
            )
        try:
            self.schema = Schema.from_json(attributes.get("arrays"))
        except ValueError as error:
            raise self._arrays.refusal(printable(error)) from None
        if self.schema.names(Role.DERIVED) != self.schema.names():
            raise self._arrays.refusal("not all of them were derived")
        self.artifact = str(attributes.get("episodes"))
        self.episode_ends: NDArray[np.int64] = self._arrays.read_ends()
        self._lengths: NDArray[np.int64] = np.diff(self.episode_ends, prepend=0)
        # Older versions wrote columns of all episodes, and did not record what had drawn them.
        covered = attributes.get("covered", [True] * len(self.episode_ends))
        drawn_by = attributes.get(DRAWN_BY, [])
        if not _holds(covered, bool) or len(covered) != len(self.episode_ends) or not _holds(drawn_by, str):
            raise self._arrays.refusal("what they cover, or what drew them, is not said")
        self.covered: NDArray[np.bool_] = np.array(covered, bool)
        self.drawn_by: tuple[str, ...] = tuple(drawn_by)

    def check_belong(self, episodes: Path, episode_ends: NDArray[np.int64]) -> None:
        """Refuse columns of other episodes than those of an artifact.

        Args:
            episodes: Folder of the artifact.
            episode_ends: Its index one past the last step of each episode.

        Raises:
            ArtifactError: If they are of others.
        """
        if self.artifact != episodes.name:
            raise ArtifactError(
                f"the columns in '{self.folder}' belong to the episodes {printable(self.artifact)}, "
                f"not to {episodes.name}; derive them from these"
            )
        if not np.array_equal(self.episode_ends, episode_ends):
            raise ArtifactError(
                f"the columns in '{self.folder}' are of {len(self.episode_ends)} episodes that end elsewhere than the "
                f"{len(episode_ends)} in '{episodes}'; derive them from these"
            )

    def steps(self, name: str, span: slice = slice(None)) -> Array:
        """All steps of all episodes of an array ``(sum of lengths, ...)``, or some of them.

        Args:
            name: Name of the array.
            span: Which steps, one after another, counted over all episodes of the artifact.

        Raises:
            ArtifactError: If there is no such array, or not all of these steps are covered.
        """
        if name not in self.schema:
            known = did_you_mean(name, self.schema.names())
            raise ArtifactError(f"the columns in '{self.folder}' have no array '{printable(name)}'{known}")
        start, stop, _ = span.indices(int(self._lengths.sum()))
        first, last = np.searchsorted(self.episode_ends, (start, stop - 1), side="right")
        if start < stop and not self.covered[first : last + 1].all():
            missing = first + int(self.covered[first:].argmin())
            raise ArtifactError(
                f"the columns in '{self.folder}' cover {_share(self.covered)} episodes of {printable(self.artifact)}, "
                f"and not number {missing}; derive them from it, too"
            )
        left_out = int(self._lengths[:first][~self.covered[:first]].sum())
        length = int(self._lengths[self.covered].sum())
        return self._arrays.read(f"data/{name}", self.schema[name], length, slice(start - left_out, stop - left_out))


def _share(covered: NDArray[np.bool_]) -> str:
    """E.g. ``3 of the 8``."""
    return f"the {len(covered)}" if covered.all() else f"{covered.sum()} of the {len(covered)}"


def _holds(values: Any, kind: type) -> bool:
    """Whether a description has a list of one type here."""
    return isinstance(values, list) and all(isinstance(each, kind) for each in values)


def _array(group: zarr.Group, spec: ArraySpec) -> GrowingArray:
    step_bytes = math.prod(size or 0 for size in spec.shape) * np.dtype(spec.dtype).itemsize
    if step_bytes == 0:
        raise InvalidEpisode(f"column '{spec.name}' needs the sizes of its entries, got {spec.shape}")
    chunk = max(CHUNK_STEPS, CHUNK_BYTES // step_bytes)
    return GrowingArray(group, f"data/{spec.name}", spec, chunk, chunk * max(1, SHARD_BYTES // (chunk * step_bytes)))
