"""Images of displaced states, drawn by several processes into files that are mapped into memory."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import numpy as np

from juicer.displacements import Displacements
from juicer.estimation.lessons import Lessons
from juicer.estimation.perturbation import Scene
from juicer.estimation.scenes import ChosenSteps, displaced
from juicer.imaging.processes import DrawingProcesses, Scenes
from juicer.progress import Progress, silent_progress
from juicer.storage.episodes import EpisodeReader
from juicer.storage.room import require_room
from juicer.views import View

BATCH = 64
"""Scenes that a process draws at a time."""
DONE_FILE = "scenes.npz"
"""Written last: what is true of the scenes whose images are all there."""


def draw_lessons(
    reader: EpisodeReader,
    chosen: ChosenSteps,
    displacements: Displacements,
    views: Collection[View],
    folder: Path,
    *,
    seed: int,
    workers: int,
    progress: Progress = silent_progress,
) -> Lessons:
    """Displace recorded steps and draw them.

    Args:
        reader: The recorded episodes.
        chosen: Which of their steps.
        displacements: How far things are displaced.
        views: What is drawn of each.
        folder: Where the files of images go. If all of them are there already, they are taken as they are.
        seed: Decides the displacements.
        workers: Processes that draw.
        progress: Called with the images that are drawn.

    Raises:
        StateMissing: If the episodes hold no simulator states.
        InvalidEpisode: If a state is none of the task's scene.
        RenderingUnavailable: If no OpenGL platform can draw.
        StoreNotWritable: If the disk has too little room.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / DONE_FILE).exists():
        return _drawn_before(folder, chosen, views)
    total = len(chosen.steps)
    needed = total * sum(view.width * view.height * 3 for view in views)
    require_room(folder, needed, f"the images of {total:,} displaced states")
    scenes = _Remembered(displaced(reader, chosen.steps, displacements, seed), BATCH)
    task, drawn, drawn_by = reader.records[0].task, {}, set[str]()
    for number, view in enumerate(views):
        images = np.memmap(folder / view.name, np.uint8, "w+", shape=(total, view.height, view.width, 3))
        with DrawingProcesses(task, view, workers) as processes:
            drawn_by |= {*processes.drawn_by}
            for batch, found in enumerate(processes.draw(scenes.batches())):
                done = min((batch + 1) * BATCH, total)
                images[batch * BATCH : done] = found
                progress(number * total + done, total * len(views))
        drawn[view.name] = images
    observations = {
        "proprioception": np.stack([scene.proprioception for scene in scenes.all]),
        "part_poses": np.stack([scene.part_poses for scene in scenes.all]),
    }
    with (folder / DONE_FILE).open("wb") as file:
        np.savez(file, allow_pickle=False, drawn_by=sorted(drawn_by), **observations)
    return Lessons(drawn, observations, chosen.critical_states, tuple(sorted(drawn_by)))


def _drawn_before(folder: Path, chosen: ChosenSteps, views: Collection[View]) -> Lessons:
    """What a run that was killed later has drawn."""
    total = len(chosen.steps)
    images = {
        view.name: np.memmap(folder / view.name, np.uint8, "r", shape=(total, view.height, view.width, 3))
        for view in views
    }
    with np.load(folder / DONE_FILE) as known:
        observations = {name: known[name] for name in ("proprioception", "part_poses")}
        return Lessons(images, observations, chosen.critical_states, tuple(known["drawn_by"].tolist()))


class _Remembered:
    """Scenes in batches, made while the first view is drawn and remembered for the others.

    Attributes:
        all: Those that were made.
    """

    def __init__(self, scenes: Iterator[Scene], size: int) -> None:
        self.all: list[Scene] = []
        self._scenes = scenes
        self._size = size

    def batches(self) -> Iterator[Scenes]:
        start = 0
        while batch := self._batch(start):
            yield Scenes(
                np.stack([scene.positions for scene in batch]), np.stack([scene.proprioception[:3] for scene in batch])
            )
            start += len(batch)

    def _batch(self, start: int) -> Sequence[Scene]:
        while len(self.all) < start + self._size and (scene := next(self._scenes, None)) is not None:
            self.all.append(scene)
        return self.all[start : start + self._size]
