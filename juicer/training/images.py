"""Images of a training: unpacked once, by long reads, into files that are mapped into memory; windows are then rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from filelock import FileLock
from numpy.typing import NDArray

from juicer.errors import ArtifactError
from juicer.progress import Progress, silent_progress
from juicer.storage.dataset import DatasetRow
from juicer.storage.episodes import EpisodeReader
from juicer.storage.room import new_images, require_room
from juicer.views import ImageSpec

READ_BYTES = 2**26
"""What is unpacked at once, in memory."""


class Chosen(NamedTuple):
    """Episodes of one artifact.

    Attributes:
        reader: The artifact, with the columns that hold the images.
        rows: Which of its episodes, in order.
    """

    reader: EpisodeReader
    rows: Sequence[DatasetRow]


def unpack_images(
    groups: Sequence[Chosen], specs: Sequence[ImageSpec], folder: Path, progress: Progress = silent_progress
) -> dict[str, NDArray[np.uint8]]:
    """Images at all steps of some episodes, one after another: arrays ``(S, height, width, 3)`` by name.

    Whoever trains the same, in other processes or after a kill, finds them unpacked.

    A memory that can hold them will: the system keeps there what it reads, and drops it when it needs the room. So no
    window costs a read from the disk, or each does, and the program is the same.

    Args:
        groups: The episodes.
        specs: Which images.
        folder: Where the files go; it must be for these episodes alone.
        progress: Called with the share that is unpacked.

    Raises:
        ArtifactError: If there are no images of a view, or they are of another size.
        DamagedArtifact: If some have other content than when they were written.
        StoreNotWritable: If the disk has too little room.
    """
    if not specs:
        return {}
    sizes = {spec.name: math.prod(_sizes(spec)) for spec in specs}
    spans = [list(_spans(group, max(1, READ_BYTES // max(sizes.values())))) for group in groups]
    total = sum(span.stop - span.start for each in spans for span in each)
    for group in groups:
        _check(group.reader, specs)
    folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / "unpacking.lock"):
        missing = [spec for spec in specs if not (folder / spec.name).exists()]
        for spec in missing:
            # What a killed process left takes the room that is asked for now.
            _draft(folder, spec).unlink(missing_ok=True)
        needed = total * sum(sizes[spec.name] for spec in missing)
        require_room(folder, needed, f"the images of {total:,} steps, unpacked for the training,")
        for number, spec in enumerate(missing):
            _unpack(groups, spans, spec, folder, total, _part(progress, number, len(missing)))
    return {spec.name: np.memmap(folder / spec.name, np.uint8, "r", shape=(total, *_sizes(spec))) for spec in specs}


def _unpack(
    groups: Sequence[Chosen],
    spans: Sequence[Sequence[slice]],
    spec: ImageSpec,
    folder: Path,
    total: int,
    progress: Callable[[float], None],
) -> None:
    """Write the file of a view; under its name there is a whole one or none."""
    draft = _draft(folder, spec)
    images = new_images(draft, (total, *_sizes(spec)))
    done = 0
    for group, each in zip(groups, spans, strict=True):
        for span in each:
            steps = span.stop - span.start
            images[done : done + steps] = group.reader.steps(spec.name, span)
            done += steps
            progress(done / total)
    images.flush()
    draft.replace(folder / spec.name)


def _draft(folder: Path, spec: ImageSpec) -> Path:
    return folder / f"{spec.name}.draft"


def _part(progress: Progress, number: int, count: int) -> Callable[[float], None]:
    return lambda share: progress(0, 0, unpacked_images=f"{(number + share) / count:.0%}")


def _spans(group: Chosen, longest: int) -> Iterator[slice]:
    """The steps of the episodes, in their order, in spans that are read at once."""
    for span in group.reader.spans(group.reader.find(row.episode_id) for row in group.rows):
        for first in range(span.start, span.stop, longest):
            yield slice(first, min(first + longest, span.stop))


def _check(reader: EpisodeReader, specs: Sequence[ImageSpec]) -> None:
    for spec in specs:
        if spec.name not in reader.schema or not reader.schema[spec.name].fits(_sizes(spec), np.dtype(spec.dtype)):
            raise ArtifactError(
                f"the policy looks at {spec.view}, and the dataset has no such images of the episodes in "
                f"'{reader.folder}'; draw them by the stage 'render', or run the whole loop"
            )


def _sizes(spec: ImageSpec) -> tuple[int, int, int]:
    return (spec.view.height, spec.view.width, 3)
