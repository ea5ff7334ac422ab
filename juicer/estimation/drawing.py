"""Images of displaced states, drawn by several processes into files that are mapped into memory."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from juicer.displacements import Displacements
from juicer.estimation.drawn import DrawnStates
from juicer.estimation.perturbation import Scene
from juicer.estimation.scenes import ChosenSteps, displaced
from juicer.imaging.processes import DrawingProcesses, Scenes
from juicer.progress import Progress, silent_progress
from juicer.storage.episodes import EpisodeReader
from juicer.storage.room import new_images, require_room
from juicer.views import View

BATCH = 64
"""States that a process draws at a time."""
DONE_FILE = "states.npz"
"""Written last: what is true of the states whose images are all there."""


@dataclass(frozen=True)
class StatesToDraw:
    """Which states are drawn.

    Attributes:
        chosen: Recorded steps.
        displacements: How far things are displaced in them.
    """

    chosen: ChosenSteps
    displacements: Displacements


def draw_states(
    reader: EpisodeReader,
    sets: Mapping[str, StatesToDraw],
    views: Sequence[View],
    folder: Path,
    *,
    seed: int,
    workers: int,
    progress: Progress = silent_progress,
) -> dict[str, DrawnStates]:
    """Displace recorded steps and draw them.

    Args:
        reader: The recorded episodes.
        sets: Sets of states, by name.
        views: What is drawn of each state.
        folder: Where the files of images go. A set whose images are all there is taken as it is.
        seed: Decides the displacements.
        workers: Processes that draw.
        progress: Called with the states that are drawn.

    Raises:
        StateMissing: If the episodes hold no simulator states.
        InvalidEpisode: If a state is none of the task's scene.
        RenderingUnavailable: If no OpenGL platform can draw.
        StoreNotWritable: If the disk has too little room.
    """
    folder.mkdir(parents=True, exist_ok=True)
    missing = {name: each for name, each in sets.items() if not (folder / name / DONE_FILE).exists()}
    for name in missing:
        shutil.rmtree(folder / name, ignore_errors=True)
    total = sum(len(each.chosen.steps) for each in missing.values())
    needed = total * sum(view.width * view.height * 3 for view in views)
    require_room(folder, needed, f"the images of {total:,} displaced states")
    if missing:
        with DrawingProcesses(reader.records[0].task, views, workers) as processes:
            done = 0
            for name, each in missing.items():
                for drawn in _draw(reader, each, views, folder / name, seed, processes):
                    progress(done + drawn, total)
                done += len(each.chosen.steps)
    return {name: _read(folder / name, each.chosen, views) for name, each in sets.items()}


def _draw(
    reader: EpisodeReader,
    states: StatesToDraw,
    views: Sequence[View],
    folder: Path,
    seed: int,
    processes: DrawingProcesses,
) -> Iterator[int]:
    """Draw a set of states; yields how many are drawn."""
    folder.mkdir()
    total = len(states.chosen.steps)
    images = {name: new_images(folder / name, shape) for name, shape in _shapes(total, views)}
    scenes: list[Scene] = []

    def batches() -> Iterator[Scenes]:
        ahead = displaced(reader, states.chosen.steps, states.displacements, seed)
        while batch := list(islice(ahead, BATCH)):
            scenes.extend(batch)
            yield Scenes(
                np.stack([scene.positions for scene in batch]), np.stack([scene.proprioception[:3] for scene in batch])
            )

    done = 0
    for batch in processes.draw(batches()):
        for name, found in batch.items():
            images[name][done : done + BATCH] = found
        done = min(done + BATCH, total)
        yield done
    for each in images.values():
        each.flush()
    draft = folder / f"{DONE_FILE}.draft"
    with draft.open("wb") as file:
        np.savez(
            file,
            allow_pickle=False,
            drawn_by=processes.drawn_by,
            proprioception=np.stack([scene.proprioception for scene in scenes]),
            part_poses=np.stack([scene.part_poses for scene in scenes]),
        )
    draft.replace(folder / DONE_FILE)


def _read(folder: Path, chosen: ChosenSteps, views: Sequence[View]) -> DrawnStates:
    shapes = _shapes(len(chosen.steps), views)
    images = {name: np.memmap(folder / name, np.uint8, "r", shape=shape) for name, shape in shapes}
    with np.load(folder / DONE_FILE) as known:
        observations = {name: known[name] for name in ("proprioception", "part_poses")}
        return DrawnStates(images, observations, chosen.critical_states, tuple(known["drawn_by"].tolist()))


def _shapes(total: int, views: Sequence[View]) -> Iterator[tuple[str, tuple[int, ...]]]:
    return ((view.name, (total, view.height, view.width, 3)) for view in views)
