"""Pictures of recorded episodes: their simulator states are restored and looked at again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from juicer.episode import STATE_KEY, Episode
from juicer.errors import ConfigError, JuicerError
from juicer.sim.env import AssemblyEnv

Picture = NDArray[np.uint8]


def draw(
    episode: Episode, steps: Iterable[int], camera: str = "front", width: int = 640, height: int = 480
) -> Iterator[Picture]:
    """Pictures ``(height, width, 3)`` of the states before the given steps; step ``T`` is the state at the end.

    Raises:
        RenderingUnavailable: If no OpenGL platform can draw.
        ConfigError: If there is no such camera.
    """
    env = AssemblyEnv(episode.record.task, episode.record.randomness)
    try:
        for step in steps:
            state = episode.steps[STATE_KEY][step] if step < len(episode) else episode.final[STATE_KEY]
            env.set_state(np.asarray(state, dtype=np.float64))
            yield env.render_camera(camera, width, height)
    finally:
        env.close()


def evenly_spaced(episode: Episode, count: int) -> list[int]:
    """Steps from the first to the end, ``count`` of them or as many as there are."""
    return sorted({round(step) for step in np.linspace(0, len(episode), count)})


def write_video(path: Path, pictures: Iterable[Picture], frames_per_second: int = 20) -> int:
    """Write an H.264 film under its name once it is whole; gives the number of frames.

    Raises:
        ConfigError: If the file cannot be written, or its ending names no film format.
        JuicerError: Whatever the pictures raise.
    """
    count = 0
    try:
        with _draft_of(path) as draft, av.open(str(draft), "w") as container:
            stream = container.add_stream("libx264", rate=Fraction(frames_per_second))
            stream.pix_fmt = "yuv420p"
            stream.options = {"crf": "23", "preset": "veryfast"}
            for picture in pictures:
                if count == 0:
                    stream.height, stream.width = picture.shape[:2]
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
                count += 1
            container.mux(stream.encode())
    except JuicerError:  # some are ValueErrors too, and tell of the episode
        raise
    except (av.error.FFmpegError, OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(
            f"film '{path}' cannot be written: {reason}; name a writable file that ends in .mp4"
        ) from None
    return count


def write_strip(path: Path, pictures: Sequence[Picture]) -> None:
    """Write pictures side by side as one PNG, under its name once it is whole.

    Raises:
        ConfigError: If the file cannot be written.
    """
    try:
        with _draft_of(path) as draft:
            Image.fromarray(np.concatenate(list(pictures), axis=1)).save(draft)
    except OSError as error:
        raise ConfigError(f"picture '{path}' cannot be written: {error.strerror or error}") from None


@contextmanager
def _draft_of(path: Path) -> Iterator[Path]:
    """A hidden file beside ``path`` with the same ending, which takes its place unless something goes wrong."""
    draft = path.with_name(f".draft.{path.name}")
    try:
        yield draft
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
