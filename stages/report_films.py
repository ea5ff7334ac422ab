"""Films and film strips for the report."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from juicer.episode import Episode, Outcome
from juicer.progress import Progress
from juicer.reporting.content import FilmStrip
from juicer.sim.env import STEP_S
from juicer.sim.film import Picture, draw, evenly_spaced, write_video

PICTURES = 8
PICTURE_SIZE = (320, 240)
STEPS_A_FRAME = 2


def make_strips(examples: list[tuple[str, Episode]], film: Path, progress: Progress) -> tuple[FilmStrip, ...]:
    """A strip for each example, and a film of the success if there is one.

    Raises:
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    width, height = PICTURE_SIZE
    strips = []
    for model, episode in examples:
        steps = _moments(episode)
        strips.append(_strip(model, episode, steps, list(draw(episode, steps, width=width, height=height))))
        if _is_success(episode):
            write_video(film, _frames(episode, progress))
    return tuple(strips)


def _frames(episode: Episode, progress: Progress) -> Iterator[Picture]:
    width, height = PICTURE_SIZE
    steps = range(0, len(episode) + 1, STEPS_A_FRAME)
    for done, picture in enumerate(draw(episode, steps, width=width, height=height), start=1):
        progress(done, len(steps))
        yield picture


def _moments(episode: Episode) -> list[int]:
    """Steps worth a picture: the milestones, and evenly spaced ones between start and end."""
    milestones = sorted(set(episode.record.milestones.values()))
    rest = max(2, PICTURES - len(milestones))
    return sorted({*milestones, *evenly_spaced(episode, rest)})[: PICTURES + 2]


def _strip(model: str, episode: Episode, steps: list[int], pictures: list[Picture]) -> FilmStrip:
    record = episode.record
    missed = "" if _is_success(episode) else f"; it ended as {record.outcome.value.replace('_', ' ')}"
    return FilmStrip(
        title="A success" if _is_success(episode) else "A typical failure",
        caption=f"{model}, initial state {record.seed}, {len(episode)} steps{missed}",
        frames=np.stack(pictures),
        seconds=tuple(step * STEP_S for step in steps),
        labels={steps.index(step): name for name, step in record.milestones.items() if step in steps},
    )


def _is_success(episode: Episode) -> bool:
    return episode.record.outcome is Outcome.SUCCESS
