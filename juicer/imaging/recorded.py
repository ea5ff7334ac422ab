"""Images of recorded steps, drawn from their stored states; nothing is simulated again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain

import numpy as np

from juicer.episode import STATE_KEY
from juicer.errors import NothingLeft
from juicer.imaging.processes import DrawingProcesses, ImagesOfViews, Scenes
from juicer.progress import Progress, silent_progress
from juicer.sim.sections import joint_positions
from juicer.storage.arrays import Array
from juicer.storage.columns import CHUNK_STEPS, stored_bytes
from juicer.storage.episodes import EpisodeReader
from juicer.tasks.registry import get_task
from juicer.views import View

BATCH = 64
"""Steps that a process draws at a time."""
SAMPLES = 4
"""Chunks that are drawn before all others, to know what they take on the disk."""

MadeOfImages = Callable[[slice, ImagesOfViews], Mapping[str, Array]]
"""Arrays by name of the images of some steps, and which steps these are."""


def _as_they_are(steps: slice, images: ImagesOfViews) -> ImagesOfViews:
    return images


@contextmanager
def drawing_of(
    reader: EpisodeReader, views: Sequence[View], workers: int, chosen: Sequence[int] | None = None
) -> Iterator[RecordedImages]:
    """Draw views of episodes of an artifact.

    Args:
        reader: The artifact.
        views: What is drawn.
        workers: Processes that draw.
        chosen: Which of its episodes; all if None.

    Raises:
        StateMissing: If the episodes hold no simulator states.
        NothingLeft: If there is no episode.
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    reader.require_state()
    chosen = range(len(reader)) if chosen is None else chosen
    if not chosen:
        raise NothingLeft(
            f"of the {len(reader)} episodes in '{reader.folder}' none is wanted, so there is nothing to draw"
        )
    with DrawingProcesses(reader.records[0].task, views, workers) as processes:
        yield RecordedImages(reader, views, processes, chosen)


class RecordedImages:
    """Images of views at every step of episodes of an artifact.

    Attributes:
        task: The task that they show.
        drawn_by: What draws them, in the words of OpenGL platforms.
        num_steps: How many steps there are.
    """

    def __init__(
        self, reader: EpisodeReader, views: Sequence[View], processes: DrawingProcesses, chosen: Sequence[int]
    ) -> None:
        """Take note of what is to be drawn; use :func:`drawing_of`."""
        self._reader = reader
        self._views = views
        self._processes = processes
        self.task = get_task(reader.records[0].task)
        self._batches = [
            [slice(first, min(first + BATCH, span.stop)) for first in range(span.start, span.stop, BATCH)]
            for index in chosen
            for span in reader.spans([index])
        ]
        self.drawn_by = processes.drawn_by
        self.num_steps = int(reader.lengths[chosen].sum())

    def stored_bytes(self) -> float:
        """What all of them will take on a disk, as measured on a few."""
        batches = list(chain.from_iterable(self._batches))
        places = np.unique(np.linspace(0, len(batches) - 1, SAMPLES).astype(int)).tolist()
        spans = [
            slice(batch.start, min(batch.start + CHUNK_STEPS, batch.stop)) for batch in map(batches.__getitem__, places)
        ]
        samples = list(self._drawn(spans))
        sampled: int = sum(span.stop - span.start for span in spans)
        stored = sum(
            stored_bytes(view.column, np.concatenate([images[view.name] for images in samples])) for view in self._views
        )
        return stored / sampled * self.num_steps

    @property
    def unpacked_bytes(self) -> int:
        """What all of them take raw, as a training that learns from them unpacks them."""
        return self.num_steps * sum(view.height * view.width * 3 for view in self._views)

    def episodes(
        self, progress: Progress = silent_progress, make: MadeOfImages = _as_they_are
    ) -> Iterator[dict[str, Array]]:
        """Images ``(T, height, width, 3)`` of every episode by views' names, in order, or what is made of them.

        Args:
            progress: Called with the steps done.
            make: What is made of the images of some steps, one after another; an entry for each step.

        Raises:
            InvalidEpisode: If the states are not those of scenes of the task.
        """
        drawn = self._drawn(chain.from_iterable(self._batches))
        done = 0
        for batches in self._batches:
            made = []
            for batch in batches:
                made.append(make(batch, next(drawn)))
                done += batch.stop - batch.start
                progress(done, self.num_steps)
            yield {name: np.concatenate([each[name] for each in made]) for name in made[0]}

    def _drawn(self, spans: Iterable[slice]) -> Iterator[ImagesOfViews]:
        return self._processes.draw(map(self._scenes, spans))

    def _scenes(self, span: slice) -> Scenes:
        positions = joint_positions(self.task, self._reader.steps(STATE_KEY, span))
        return Scenes(positions, self._reader.steps("proprioception", span)[:, :3])
