"""Images and videos of episodes, from their simulator states."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from juicer.episode import Episode
from juicer.errors import ConfigError
from juicer.imaging.captions import Captioner, ending
from juicer.imaging.video import Image, VideoFormat, draw, evenly_spaced, every, write_video
from juicer.provenance import provenance
from juicer.sim.arguments import checked_count, is_whole, shown
from juicer.sim.env import CONTROL_HZ


def images(episode: Episode, steps: int | Iterable[int], video_format: VideoFormat, *, captions: bool) -> list[Image]:
    """An image a step, the video's cameras side by side; see :func:`juicer.api.images`."""
    frames = draw(_checked(episode), _chosen(episode, steps), video_format)
    if captions:
        return list(Captioner(episode, video_format).captioned(frames))
    return [np.concatenate(frame.images, axis=1) for frame in frames]


def video(path: Path, episode: Episode, video_format: VideoFormat, speed: float) -> Path:
    """Write a video; see :func:`juicer.api.video`."""
    if not isinstance(speed, int | float) or not 0.1 <= speed <= 100:
        raise ConfigError(f"speed must be a number from 0.1 to 100, got {shown(speed)}")
    record = _checked(episode).record
    title = [record.task, *provenance(record), f"initial state {record.seed}", ending(episode)]
    frames = draw(episode, every(episode, 1), video_format)
    write_video(path, Captioner(episode, video_format, title).captioned(frames), round(CONTROL_HZ * speed))
    return path


def video_format_of(camera: str | Sequence[str], width: int, height: int) -> VideoFormat:
    """A video's format from arguments.

    Raises:
        ConfigError: If they do not make one.
    """
    cameras = (camera,) if isinstance(camera, str) else camera
    if not isinstance(cameras, Sequence) or not cameras:
        raise ConfigError(f"camera must be the name of a camera or several, got {shown(camera)}")
    return VideoFormat(tuple(cameras), checked_count("width", width), checked_count("height", height))


def _checked(episode: Episode) -> Episode:
    if not isinstance(episode, Episode):
        raise ConfigError(f"an episode can be drawn, not a {type(episode).__name__}; take one, as in episodes[0]")
    return episode


def _chosen(episode: Episode, steps: int | Iterable[int]) -> list[int]:
    if is_whole(steps):
        return evenly_spaced(episode, checked_count("steps", steps))
    chosen = list(steps) if isinstance(steps, Iterable) else [steps]
    for step in chosen:
        if not is_whole(step) or not 0 <= step <= len(episode):
            raise ConfigError(f"the episode has the steps 0 to {len(episode)}, and none is {shown(step)}")
    return [int(step) for step in chosen]
