"""Videos and stills of episodes for the report."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from juicer.episode import Episode, Outcome
from juicer.imaging.captions import Captioner, ending
from juicer.imaging.video import Frame, Image, VideoFormat, draw, evenly_spaced, every, write_video
from juicer.progress import Progress
from juicer.reporting.content import EpisodeVideo, Moment
from juicer.sim.env import STEP_S
from juicer.views import View

MOMENTS = 8
FORMAT = VideoFormat(width=320, height=240)
TEXT_PX = 19
"""Letters that stay legible when the video is as narrow as a telephone."""

SMALLEST_STRIDE = 2
MOST_FRAMES = 300
FRAMES_PER_SECOND = 20
QUALITY = 28
"""Coarser than a replay: the videos are part of the page."""


@dataclass(frozen=True)
class Example:
    """An episode to be shown.

    Attributes:
        model: Whose it is, e.g. ``TA+CI, seed 0``.
        evaluation: Id of the evaluation that keeps it.
        number: Its number in the evaluation.
        episode: The episode.
        views: What the policy looked at.
    """

    model: str
    evaluation: str
    number: int
    episode: Episode
    views: tuple[View, ...] = ()

    @property
    def is_success(self) -> bool:
        """Whether it succeeded."""
        return self.episode.record.outcome is Outcome.SUCCESS

    @property
    def file_name(self) -> str:
        """Name of its video."""
        return "success.mp4" if self.is_success else "failure.mp4"


def make_videos(examples: list[Example], folder: Path, progress: Progress) -> tuple[EpisodeVideo, ...]:
    """A video in ``folder`` and stills for each example.

    Raises:
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    return tuple(_make_video(example, folder / example.file_name, progress) for example in examples)


def _make_video(example: Example, path: Path, progress: Progress) -> EpisodeVideo:
    episode = example.episode
    stride = max(SMALLEST_STRIDE, math.ceil(len(episode) / MOST_FRAMES))
    steps = every(episode, stride)
    moments = _moments(episode)
    video_format = replace(FORMAT, views=example.views)
    captioner = Captioner(episode, video_format, [example.model, ending(episode)], TEXT_PX)
    stills: dict[int, Image] = {}
    shown: list[int] = []
    poster: list[Image] = []

    def images() -> Iterator[Image]:
        frame: Frame
        for frame in draw(episode, sorted({*steps, *moments}), video_format):
            if frame.step in moments:
                stills[frame.step] = frame.images[0]
            if frame.step in steps:
                progress(len(shown) + 1, len(steps))
                shown.append(frame.step)
                poster[:] = [captioner.caption(frame)]
                yield poster[0]

    write_video(path, images(), FRAMES_PER_SECOND, QUALITY)
    height, width, _ = poster[0].shape
    return EpisodeVideo(
        title="A success" if example.is_success else "A typical failure",
        caption=_caption(example, stride, len(steps) - len(shown)),
        mp4=path.read_bytes(),
        width=width,
        height=height,
        poster=poster[0],
        moments=tuple(_moment(episode, step, stills[step], shown) for step in sorted(stills)),
    )


def _moments(episode: Episode) -> set[int]:
    """Steps worth a still: the milestones, and evenly spaced ones between start and end."""
    milestones = sorted(set(episode.record.milestones.values()))
    steps = sorted({*milestones, *evenly_spaced(episode, max(2, MOMENTS - len(milestones)))})
    count = min(len(steps), MOMENTS + 2)
    return {steps[round(place)] for place in np.linspace(0, len(steps) - 1, count)}


def _moment(episode: Episode, step: int, image: Image, shown: list[int]) -> Moment:
    names = [name.replace("_", " ") for name, at in episode.record.milestones.items() if at == step]
    frame = sum(at < step for at in shown)
    return Moment(image, step, step * STEP_S, frame / FRAMES_PER_SECOND, ", ".join(names))


def _caption(example: Example, stride: int, left_out: int) -> str:
    record = example.episode.record
    speed = Fraction(stride * FRAMES_PER_SECOND) * Fraction(STEP_S).limit_denominator(1000)
    told = (
        f"{example.model}, episode {example.number}, initial state {record.seed}: {ending(example.episode)}. "
        f"Front and wrist camera, {float(speed):g} times real time."
        + (" Below: what the policy saw." if example.views else "")
    )
    if left_out:
        told += f" Frames left out: {left_out}; the simulation diverged there, and its state cannot be drawn."
    return told
