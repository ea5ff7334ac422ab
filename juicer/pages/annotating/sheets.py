"""Steps of a demonstration as sheets of small images, drawn from its recorded states."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from PIL import Image

from juicer.episode import STATE_KEY, Episode
from juicer.errors import ConfigError
from juicer.imaging.renderer import ViewRenderer
from juicer.sim.sections import joint_positions
from juicer.tasks.registry import get_task
from juicer.views import GazeCrop, View

WIDTH, HEIGHT = 320, 240
STEPS = 8
"""Steps on a sheet: so few that it is there at once, so many that looking around needs few of them."""
VIEWS = {
    "front": View(camera="front", width=WIDTH, height=HEIGHT),
    "close": View(camera="front", crop=GazeCrop(reach_m=0.07), width=WIDTH, height=HEIGHT),
    "wrist": View(camera="wrist", width=WIDTH, height=HEIGHT),
}
_QUALITY = 82


def draw_sheet(renderer: ViewRenderer, episode: Episode, first: int, count: int, views: Sequence[str]) -> bytes:
    """JPEG of some steps, side by side, a row for each view.

    Args:
        renderer: Draws the episode's task.
        episode: What is drawn.
        first: First step.
        count: How many there are, as far as the episode goes.
        views: Names of views, from top to bottom.

    Raises:
        ConfigError: If there is no such step or view.
        RenderingUnavailable: If nothing can be drawn on this machine.
    """
    if not 0 <= first < len(episode):
        raise ConfigError(f"the demonstration has the steps 0 to {len(episode) - 1}, and not {first}")
    if not 0 < count <= STEPS or not views or not set(views) <= VIEWS.keys():
        raise ConfigError(f"a sheet shows 1 to {STEPS} steps in the views {', '.join(VIEWS)}")
    span = slice(first, min(first + count, len(episode)))
    positions = joint_positions(get_task(episode.record.task), np.asarray(episode.steps[STATE_KEY][span]))
    gaze = np.asarray(episode.steps["proprioception"][span, :3], dtype=np.float32)
    rows = [
        np.concatenate(
            [renderer.draw(qpos, VIEWS[name], point) for qpos, point in zip(positions, gaze, strict=True)], 1
        )
        for name in views
    ]
    file = io.BytesIO()
    Image.fromarray(np.concatenate(rows)).save(file, "JPEG", quality=_QUALITY)
    return file.getvalue()
