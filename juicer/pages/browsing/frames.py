"""Images of recorded episodes for a page, as JPEG: many small ones in one sheet, or one large one of a step."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Episode
from juicer.errors import ConfigError
from juicer.imaging.jpeg import encode_jpeg
from juicer.pages.browsing.episodes import list_episodes, recorded_episode
from juicer.pages.drawing import Image, draw_steps, positions_of, renderer_of
from juicer.views import FRONT_CAMERA, WRIST_CAMERA, View

SHEET_FRAMES = 50
"""Of a sheet, at most: about 150 kB, drawn in a fraction of a second."""
SHEET_COLUMNS = 10
FRAME_WIDTH, FRONT_HEIGHT, WRIST_HEIGHT = 160, 120, 90
FRAME_HEIGHT = FRONT_HEIGHT + WRIST_HEIGHT
"""A frame of a sheet is the front camera's image above that of the wrist camera."""
STILL_HEIGHT, STILL_WIDTHS = 360, {FRONT_CAMERA: 480, WRIST_CAMERA: 640}

_SMALL = (
    View(camera="front", width=FRAME_WIDTH, height=FRONT_HEIGHT),
    View(camera="wrist", width=FRAME_WIDTH, height=WRIST_HEIGHT),
)


@lru_cache(maxsize=128)
def sheet(store: ArtifactStore, ref: ArtifactRef, number: int, first: int, stride: int, count: int) -> bytes:
    """Steps of an episode, row by row in :data:`SHEET_COLUMNS` columns.

    Args:
        store: Where the artifact is.
        ref: The artifact.
        number: Number of the episode.
        first: First step.
        stride: Steps from one to the next.
        count: How many, as far as the episode goes on; the step after the last one is the end.

    Raises:
        ArtifactError: If there is no such recording.
        ConfigError: If there is no such step.
        StateMissing: If it has no simulator states.
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    episode = recorded_episode(store, ref, number)
    if first > len(episode):
        raise ConfigError(f"the episode has the steps 0 to {len(episode)}, and not {first}")
    frames = _drawn_small(episode, range(first, min(first + stride * count, len(episode) + 1), stride))
    columns = min(SHEET_COLUMNS, len(frames))
    rows = -(-len(frames) // columns)
    picture = np.zeros((rows * FRAME_HEIGHT, columns * FRAME_WIDTH, 3), np.uint8)
    for place, frame in enumerate(frames):
        row, column = divmod(place, columns)
        picture[row * FRAME_HEIGHT : (row + 1) * FRAME_HEIGHT, column * FRAME_WIDTH : (column + 1) * FRAME_WIDTH] = (
            frame
        )
    return encode_jpeg(picture)


@lru_cache(maxsize=64)
def still(store: ArtifactStore, ref: ArtifactRef, number: int, step: int) -> bytes:
    """A step of an episode as well as can be drawn here, both cameras side by side.

    Raises:
        ArtifactError: If there is no such recording.
        StateMissing: If it has no simulator states, or no such step.
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    episode = recorded_episode(store, ref, number)
    renderer, positions = renderer_of(episode.record.task), positions_of(episode, step)
    images = [renderer.draw_for_people(positions, name, width, STILL_HEIGHT) for name, width in STILL_WIDTHS.items()]
    return encode_jpeg(np.concatenate(images, axis=1))


@lru_cache(maxsize=128)
def strip(store: ArtifactStore, ref: ArtifactRef) -> bytes:
    """Beginning and end of an artifact's first recorded episode from the front, side by side, to tell it by.

    Raises:
        ArtifactError: If there is no recording.
        StateMissing: If it has no simulator states.
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    episode = recorded_episode(store, ref, list_episodes(store, ref).first_recorded)
    frames = _drawn_small(episode, [0, len(episode)])
    return encode_jpeg(np.concatenate([frame[:FRONT_HEIGHT] for frame in frames], axis=1))


def _drawn_small(episode: Episode, steps: Sequence[int]) -> list[Image]:
    return [np.concatenate(images) for images in draw_steps(episode, steps, _SMALL)]
