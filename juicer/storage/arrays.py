"""Arrays on disk: growing ones that are written with checksums, and a reader that believes nothing it can check."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.store import ByteRequest
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.core.array_spec import ArrayConfigParams
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import LocalStore, WrapperStore

from juicer.artifacts.ref import is_id
from juicer.episode import ArraySpec
from juicer.errors import ArtifactError, DamagedArtifact, InvalidEpisode, UnreadableArtifact
from juicer.text import printable

MOST_BYTES = 2**36
MOST_CHUNK_BYTES = 2**30
MOST_METADATA_BYTES = 2**24
"""Of what is read at once, of a chunk and of the group's description: far more than juicer writes."""

ENDS = "meta/episode_ends"
EVERY_CHUNK = "every_chunk_is_written"
"""Attribute of a group of which a chunk that is absent has been lost; juicer once left out chunks of zeros."""

Array = NDArray[Any]


def create_group(path: Path) -> zarr.Group:
    """Make an empty group for arrays in a folder that does not exist yet."""
    return zarr.open_group(path, mode="w-", zarr_format=3, attributes={EVERY_CHUNK: True})


class GrowingArray:
    """Time-major array that touches the disk a whole number of chunks, or of shards, at a time."""

    def __init__(self, group: zarr.Group, path: str, spec: ArraySpec, chunk: int, shard: int | None = None) -> None:
        """Make an empty array.

        Args:
            group: Where.
            path: Its name there.
            spec: Shape and type of a step's entry; every size must be known.
            chunk: Steps that are packed together.
            shard: Steps that share a file, a multiple of ``chunk``; a file for every chunk if None.
        """
        self._name = spec.name
        self._shape = tuple(size or 0 for size in spec.shape)
        self._at_once = shard or chunk
        self._pending: list[Array] = []
        self._array = group.create_array(
            path,
            shape=(0, *self._shape),
            chunks=(chunk, *self._shape),
            shards=None if shard is None else (shard, *self._shape),
            dtype=np.dtype(spec.dtype),
            compressors=_codecs(np.dtype(spec.dtype), chunk * math.prod(self._shape)),
            config=_WRITE_ALL,
        )

    def append(self, values: Array) -> None:
        """Add steps ``(T, ...)``.

        Raises:
            InvalidEpisode: If shape or type are not those of the array.
        """
        if values.shape[1:] != self._shape:
            raise InvalidEpisode(
                f"array '{self._name}' has shape {values.shape[1:]} a step but {self._shape} in the episodes before"
            )
        if values.dtype != self._array.dtype:
            raise InvalidEpisode(f"array '{self._name}' holds {values.dtype} but must hold {self._array.dtype}")
        # A copy: the end of an episode is often a view that would keep all of it in memory.
        self._pending.append(values.copy())
        if sum(map(len, self._pending)) >= self._at_once:
            pending = np.concatenate(self._pending)
            full = len(pending) // self._at_once * self._at_once
            self._array.append(pending[:full])
            self._pending = [pending[full:]]

    @property
    def nbytes_stored(self) -> int:
        """Bytes of what has been written."""
        return self._array.nbytes_stored()

    def flush(self) -> None:
        """Write what does not fill a chunk."""
        if rest := [values for values in self._pending if len(values)]:
            self._array.append(np.concatenate(rest))


def write_ends(group: zarr.Group, lengths: Sequence[int]) -> None:
    """Write the index one past the last step of each episode."""
    ends = np.cumsum(lengths, dtype=np.int64)
    chunks = (max(1, len(ends)),)
    group.create_array(ENDS, data=ends, chunks=chunks, compressors=_codecs(ends.dtype), config=_WRITE_ALL)


class _ChunksThatVanish(WrapperStore[LocalStore]):
    """A folder of arrays; a chunk that is gone is an error if ``every_chunk_is_written``, where zarr reads zeros."""

    every_chunk_is_written = False

    async def get(self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None) -> Buffer | None:
        found = await super().get(key, prototype, byte_range)
        if found is None and self.every_chunk_is_written and "/c/" in key:
            raise _ChunkVanished
        return found


class _ChunkVanished(Exception):
    """A chunk that was written is absent."""


class StoredArrays:
    """Read access to a group of arrays; everything is read from disk when asked for, and compared with its checksum.

    Attributes:
        attributes: The facts stored with the group.
    """

    def __init__(self, path: Path, what: str) -> None:
        """Open a group.

        Args:
            path: Its folder.
            what: What it holds, for messages, e.g. ``episodes``.

        Raises:
            ArtifactError: If there is none, or juicer did not write it.
        """
        self._folder = path.parent
        self._what = what
        store = _ChunksThatVanish(LocalStore(path, read_only=True))
        self._group = self._open(path, store)
        try:
            self.attributes: dict[str, Any] = dict(self._group.attrs)
        except (TypeError, ValueError):
            self.attributes = {}
        store.every_chunk_is_written = bool(self.attributes.pop(EVERY_CHUNK, False))

    def read_ends(self) -> NDArray[np.int64]:
        """Index one past the last step of each episode ``(N,)``.

        Raises:
            ArtifactError: If there are none, or they do not rise.
        """
        ends: NDArray[np.int64] = self._read(self._find(ENDS), ENDS, slice(None))
        if ends.ndim != 1 or ends.dtype != np.int64 or np.any(np.diff(ends, prepend=0) < 1):
            raise self.refusal("its episodes have no ends")
        return ends

    def read(self, path: str, spec: ArraySpec, length: int, part: slice | int) -> Array:
        """Part of an array, whose size and type are looked at before memory is taken for it.

        Args:
            path: Its name in the group.
            spec: What an entry of it must be.
            length: How many entries it must have.
            part: Which of them to read.

        Raises:
            ArtifactError: If the array is not as it must be.
            DamagedArtifact: If it cannot be unpacked, or has other content than when it was written.
            UnreadableArtifact: If the disk does not let it be read.
        """
        array = self._find(path)
        if array.shape[0] != length or not spec.fits(array.shape[1:], array.dtype):
            raise self.refusal(f"array '{path}' is not one of theirs")
        return self._read(array, path, part)

    def refusal(self, reason: str) -> ArtifactError:
        """Error that says why the group is not one that juicer wrote."""
        return ArtifactError(f"{self._what} in '{self._folder}' were not written by juicer: {reason}")

    def _open(self, path: Path, store: _ChunksThatVanish) -> zarr.Group:
        try:
            if (path / "zarr.json").stat().st_size > MOST_METADATA_BYTES:
                raise ArtifactError(f"'{path}' has a description of absurd size")
            return zarr.open_group(store, mode="r", zarr_format=3)
        except (FileNotFoundError, NotADirectoryError):
            raise ArtifactError(f"'{path.parent}' holds no {self._what}") from None
        except ArtifactError:
            raise
        # What the library raises for a description that is none is not written down.
        except Exception as error:
            raise self.refusal(printable(error)) from None

    def _find(self, path: str) -> zarr.Array[Any]:
        try:
            array = self._group[path]
        except Exception as error:
            raise self.refusal(f"array '{path}' cannot be opened: {printable(error)}") from None
        if not isinstance(array, zarr.Array) or not array.shape:
            raise self.refusal(f"'{path}' is not one of their arrays")
        chunk = array.dtype.itemsize * math.prod(array.shards or array.chunks)
        if array.dtype.kind not in "biuf" or chunk > MOST_CHUNK_BYTES:
            raise self.refusal(f"array '{path}' has an absurd size or type")
        return array

    def _read(self, array: zarr.Array[Any], path: str, part: slice | int) -> Array:
        entries = 1 if isinstance(part, int) else len(range(*part.indices(array.shape[0])))
        if entries * array.dtype.itemsize * math.prod(array.shape[1:]) > MOST_BYTES:
            raise self.refusal(f"array '{path}' has an absurd size or type")
        try:
            return np.asarray(array[part])
        except OSError as error:
            reason = f"array '{path}' cannot be read ({error.strerror})"
            raise UnreadableArtifact(
                f"{_name_of(self._folder)} may be whole, but {reason}; see to its permissions and to the disk"
            ) from None
        # Each codec has its own errors for content that is none of its own, the checksum among them.
        except Exception as error:
            raise DamagedArtifact(
                f"{_name_of(self._folder)} is damaged: array '{path}' {_damage(error)}; {_remedy(self._folder)}"
            ) from None


_WRITE_ALL: Final[ArrayConfigParams] = {"write_empty_chunks": True}


def _codecs(dtype: np.dtype[Any], entries: int = 0) -> tuple[BloscCodec, Crc32cCodec]:
    """How chunks of so many numbers are packed.

    The checksum is of what is on the disk, so that nothing damaged is ever unpacked.
    """
    if dtype.itemsize == 1:
        # Images: shuffling does nothing to single bytes, and more effort gains little. A chunk is one block, so that
        # what an image repeats of the one before is found.
        return BloscCodec(cname="zstd", clevel=3, shuffle="noshuffle", blocksize=entries), Crc32cCodec()
    return BloscCodec(cname="zstd", clevel=5, shuffle="shuffle"), Crc32cCodec()


def _damage(error: Exception) -> str:
    """What an array is, or has, that cannot be read for this error."""
    if isinstance(error, _ChunkVanished):
        return "has lost a chunk"
    if "checksum do not match" in str(error):
        return "has other content than when it was written"
    return f"cannot be unpacked: {printable(error)}"


def _artifact_of(folder: Path) -> Path | None:
    """Folder of the artifact that a folder is, or is in: ``<kind>/<id>``."""
    return next((each for each in (folder, *folder.parents) if is_id(each.name)), None)


def _name_of(folder: Path) -> str:
    artifact = _artifact_of(folder)
    return f"artifact {artifact.parent.name}/{artifact.name}" if artifact else f"what is in '{folder}'"


def _remedy(folder: Path) -> str:
    artifact = _artifact_of(folder)
    return f"recompute it with `juicer repair {artifact.name}`" if artifact else "make it again"
