"""Steps of a demonstration as sheets of small images, drawn from its recorded states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from juicer.episode import Episode
from juicer.errors import ConfigError
from juicer.imaging.jpeg import encode_jpeg
from juicer.pages.drawing import draw_steps
from juicer.views import GazeCrop, View

WIDTH, HEIGHT = 320, 240
STEPS = 8
"""Steps on a sheet: so few that it is there at once, so many that looking around needs few of them."""
VIEWS = {
    "front": View(camera="front", width=WIDTH, height=HEIGHT),
    "close": View(camera="front", crop=GazeCrop(reach_m=0.07), width=WIDTH, height=HEIGHT),
    "wrist": View(camera="wrist", width=WIDTH, height=HEIGHT),
}


def draw_sheet(episode: Episode, first: int, count: int, views: Sequence[str]) -> bytes:
    """JPEG of some steps, side by side, a row for each view.

    Args:
        episode: What is drawn.
        first: First step.
        count: How many there are, as far as the episode goes.
        views: Names of views, from top to bottom, each once at most.

    Raises:
        ConfigError: If there is no such step or view.
        RenderingUnavailable: If nothing can be drawn on this machine.
    """
    if not 0 <= first < len(episode):
        raise ConfigError(f"the demonstration has the steps 0 to {len(episode) - 1}, and not {first}")
    chosen = set(views)
    if not 0 < count <= STEPS or not 0 < len(views) == len(chosen) or not chosen <= VIEWS.keys():
        raise ConfigError(f"a sheet shows 1 to {STEPS} steps in the views {', '.join(VIEWS)}, each once at most")
    steps = range(first, min(first + count, len(episode)))
    columns = draw_steps(episode, steps, [VIEWS[name] for name in views])
    return encode_jpeg(np.concatenate([np.concatenate(column) for column in columns], axis=1))
