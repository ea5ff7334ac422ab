"""Images and videos of recorded episodes: their simulator states are restored and looked at again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from juicer.episode import Episode
from juicer.errors import ConfigError, InvalidEpisode
from juicer.imaging.renderer import ViewRenderer
from juicer.sim.env import AssemblyEnv
from juicer.views import CAMERAS, MAX_HEIGHT, MAX_WIDTH, View

Image = NDArray[np.uint8]
"""``(height, width, 3)``, RGB."""

MIN_WIDTH, MIN_HEIGHT = 160, 120
VIDEO_SUFFIXES = (".mp4", ".mov", ".mkv")
"""Endings of files that hold H.264."""


@dataclass(frozen=True)
class VideoFormat:
    """What is shown of a scene.

    Attributes:
        cameras: Names, left to right.
        width: Width of each camera's image [pixels].
        height: Its height [pixels].
        views: What a policy looked at, shown below the cameras.

    Raises:
        ConfigError: If an image of this size cannot be drawn, or carry legible captions.
    """

    cameras: tuple[str, ...] = CAMERAS
    width: int = 480
    height: int = 360
    views: tuple[View, ...] = ()

    def __post_init__(self) -> None:
        """Check the size."""
        if not (MIN_WIDTH <= self.width <= MAX_WIDTH and MIN_HEIGHT <= self.height <= MAX_HEIGHT):
            raise ConfigError(
                f"the image of a camera measures {MIN_WIDTH}x{MIN_HEIGHT} to {MAX_WIDTH}x{MAX_HEIGHT} pixels, "
                f"not {self.width}x{self.height}"
            )


@dataclass(frozen=True)
class Frame:
    """A step as every camera of a video saw it.

    Attributes:
        step: The images show the state before the action of this step; the step after the last is the end.
        images: One for each camera.
        seen: One for each view.
    """

    step: int
    images: tuple[Image, ...]
    seen: tuple[Image, ...] = ()


def draw(episode: Episode, steps: Iterable[int], video_format: VideoFormat) -> Iterator[Frame]:
    """Frames of the given steps; those whose state is not finite or cannot be restored are left out.

    A simulation that diverged ends in such a state.

    Raises:
        RenderingUnavailable: If no OpenGL platform can draw.
        ConfigError: If there is no such camera, or no such task.
        InvalidEpisode: If the states belong to another scene.
        StateMissing: If the episode has none.
    """
    env = AssemblyEnv(episode.record.task, episode.record.randomness, shift=episode.record.shift)
    renderer = ViewRenderer(episode.record.task)
    is_restorable = False
    try:
        for step in steps:
            try:
                env.set_state(episode.state(step))
            except InvalidEpisode:
                if not is_restorable:  # states of another scene
                    raise
                continue  # the simulation had diverged there
            is_restorable = True
            qpos, size = env.data.qpos, (video_format.width, video_format.height)
            end_effector = env.observation()["proprioception"][:3]
            yield Frame(
                step,
                tuple(renderer.draw_for_people(qpos, camera, *size) for camera in video_format.cameras),
                tuple(renderer.draw(qpos, view, end_effector, env.shift) for view in video_format.views),
            )
    finally:
        renderer.close()


def evenly_spaced(episode: Episode, count: int) -> list[int]:
    """Steps from the first to the end, ``count`` of them or as many as there are."""
    return sorted({round(step) for step in np.linspace(0, len(episode), count)})


def every(episode: Episode, stride: int) -> list[int]:
    """Every so many steps from the first on, and the end."""
    return sorted({*range(0, len(episode), stride), len(episode)})


def write_video(path: Path, images: Iterable[Image], frames_per_second: Fraction | int = 20, quality: int = 23) -> int:
    """Write an H.264 video under its name once it is whole; gives the number of frames.

    Args:
        path: File to write.
        images: Of one size, whose width and height are even.
        frames_per_second: How fast it is played.
        quality: Constant rate factor of H.264: lower is better and larger.

    Raises:
        ConfigError: If the file cannot be written, or its ending names no video format.
        ValueError: If an image is not one.
        Exception: Whatever the images raise.
    """
    count = 0
    try:
        with _draft_of(path) as draft, _opened(path, draft) as container:
            stream = container.add_stream("libx264", rate=Fraction(frames_per_second))
            stream.pix_fmt = "yuv420p"
            stream.options = {"crf": str(quality), "preset": "veryfast"}
            for image in images:
                if count == 0:
                    stream.height, stream.width = image.shape[:2]
                container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
                count += 1
            container.mux(stream.encode())
    except (av.error.FFmpegError, OSError) as error:
        raise _unwritable(path, error) from None
    return count


def _opened(path: Path, draft: Path) -> av.container.OutputContainer:
    try:
        return av.open(str(draft), "w", options={"movflags": "faststart"})
    except ValueError as error:  # an ending that names no format, or a name that no file can have
        raise _unwritable(path, error) from None


def _unwritable(path: Path, error: Exception) -> ConfigError:
    reason = getattr(error, "strerror", None) or error
    return ConfigError(f"video '{path}' cannot be written: {reason}; name a writable file that ends in .mp4")


def write_strip(path: Path, images: Sequence[Image]) -> None:
    """Write images side by side as one PNG, under its name once it is whole.

    Raises:
        ConfigError: If the file cannot be written.
    """
    try:
        with _draft_of(path) as draft:
            PIL.Image.fromarray(np.concatenate(list(images), axis=1)).save(draft)
    except OSError as error:
        raise ConfigError(f"image '{path}' cannot be written: {error.strerror or error}") from None


@contextmanager
def _draft_of(path: Path) -> Iterator[Path]:
    """A hidden file beside ``path`` with the same ending, which takes its place unless something goes wrong."""
    draft = path.with_name(f".draft.{path.name}")
    try:
        yield draft
        draft.replace(path)
    finally:
        with suppress(ValueError):  # a name that no file can have
            draft.unlink(missing_ok=True)
