"""Images of recorded steps, drawn from their stored states; nothing is simulated again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import numpy as np

from juicer.episode import STATE_KEY
from juicer.errors import NothingLeft
from juicer.imaging.processes import DrawingProcesses, Images, Scenes
from juicer.progress import Progress, silent_progress
from juicer.sim.sections import joint_positions
from juicer.storage.columns import CHUNK_STEPS, stored_bytes
from juicer.storage.episodes import EpisodeReader
from juicer.tasks.registry import get_task
from juicer.views import View

BATCH = 64
"""Steps that a process draws at a time."""
SAMPLES = 4
"""Chunks that are drawn before all others, to know what they take on the disk."""


@contextmanager
def drawing_of(reader: EpisodeReader, view: View, workers: int) -> Iterator[RecordedImages]:
    """Draw a view of the episodes of an artifact, by so many processes.

    Raises:
        StateMissing: If the episodes hold no simulator states.
        NothingLeft: If there is no episode.
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    reader.require_state()
    if not len(reader):
        raise NothingLeft(f"the episodes in '{reader.folder}' are none, so there is nothing to draw")
    with DrawingProcesses(reader.records[0].task, (view,), workers) as processes:
        yield RecordedImages(reader, view, processes)


class RecordedImages:
    """Images of a view at every step of the episodes of an artifact.

    Attributes:
        gl: What draws them, in the words of its OpenGL platform.
    """

    def __init__(self, reader: EpisodeReader, view: View, processes: DrawingProcesses) -> None:
        """Take note of what is to be drawn; use :func:`drawing_of`."""
        self._reader = reader
        self._view = view
        self._processes = processes
        self._task = get_task(reader.records[0].task)
        self.gl = processes.gl

    def stored_bytes(self) -> float:
        """What all of them will take on a disk, as measured on a few."""
        total = int(self._reader.episode_ends[-1])
        starts = np.unique(np.linspace(0, max(0, total - CHUNK_STEPS), SAMPLES).astype(int)).tolist()
        spans = [slice(start, min(start + CHUNK_STEPS, total)) for start in starts]
        images = np.concatenate(list(self._drawn(spans)))
        return stored_bytes(self._view.column, images) / len(images) * total

    def episodes(self, progress: Progress = silent_progress) -> Iterator[Images]:
        """Images ``(T, height, width, 3)`` of every episode, in order; progress counts steps.

        Raises:
            InvalidEpisode: If the states are not those of scenes of the task.
        """
        starts = self._reader.episode_ends - self._reader.lengths
        spans = [
            [slice(first, min(first + BATCH, end)) for first in range(start, end, BATCH)]
            for start, end in zip(starts.tolist(), self._reader.episode_ends.tolist(), strict=True)
        ]
        drawn = self._drawn(span for each in spans for span in each)
        for each in spans:
            images = []
            for span in each:
                images.append(next(drawn))
                progress(span.stop, int(self._reader.episode_ends[-1]))
            yield np.concatenate(images)

    def _drawn(self, spans: Iterable[slice]) -> Iterator[Images]:
        return (images[self._view.name] for images in self._processes.draw(map(self._scenes, spans)))

    def _scenes(self, span: slice) -> Scenes:
        positions = joint_positions(self._task, self._reader.steps(STATE_KEY, span))
        return Scenes(positions, self._reader.steps("proprioception", span)[:, :3])
