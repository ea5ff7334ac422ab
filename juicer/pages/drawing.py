"""Steps of recorded episodes as images, for whichever page shows them.

They are numbered by steps, never by the time of a video, so that what is shown is the step that is meant.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from juicer.episode import Episode
from juicer.imaging.renderer import ViewRenderer
from juicer.sim.sections import joint_positions
from juicer.tasks.registry import get_task
from juicer.views import View

Image = NDArray[np.uint8]


@cache
def renderer_of(task: str) -> ViewRenderer:
    """What draws a task; kept as long as the process: to make one takes longer than to draw with it.

    Raises:
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    return ViewRenderer(task)


def positions_of(episode: Episode, step: int) -> NDArray[np.float64]:
    """Positions of all joints ``(nq,)`` before the action of a step; at the step after the last one, at the end.

    Raises:
        StateMissing: If the episode has no simulator states, or no such step.
    """
    positions: NDArray[np.float64] = joint_positions(get_task(episode.record.task), episode.state(step)[None])[0]
    return positions


def draw_steps(episode: Episode, steps: Iterable[int], views: Sequence[View]) -> Iterator[list[Image]]:
    """Images ``(height, width, 3)`` of each view at some steps, as a policy would see them.

    Raises:
        StateMissing: If the episode has no simulator states, or no such step.
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    renderer = renderer_of(episode.record.task)
    for step in steps:
        positions = positions_of(episode, step)
        end_effector = np.asarray(episode.observation(step)["proprioception"][:3], np.float32)
        yield [renderer.draw(positions, view, end_effector) for view in views]
