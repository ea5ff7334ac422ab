"""What a shift changes in an image: light and cameras of a scene that is about to be drawn."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.geometry import rotvec_to_matrix
from juicer.shifts import Camera, Light, ShiftOfEpisode


def alter(scene: mujoco.MjvScene, episode: ShiftOfEpisode, camera: str) -> None:
    """Change lights and cameras of a scene as an episode's shift says; other kinds of shift change nothing.

    Args:
        scene: What is about to be drawn.
        episode: The shift, and what the episode makes of it.
        camera: Through which camera it is seen.
    """
    shift = episode.shift
    if isinstance(shift, Light):
        rng = episode.stream("light")
        aside = _direction(rng)
        for light in scene.lights[: scene.nlight]:
            for colour in (light.ambient, light.diffuse, light.specular):
                colour[:] = shift.brightness * colour
            if not light.headlight:
                axis = np.cross(light.dir, aside)
                turn = rotvec_to_matrix(shift.turn_rad * axis / np.linalg.norm(axis))
                light.dir[:] = turn @ light.dir
    elif isinstance(shift, Camera):
        rng = episode.stream(camera)
        offset, turn = shift.shift_m * _direction(rng), rotvec_to_matrix(shift.turn_rad * _direction(rng))
        for eye in scene.camera:
            forward, up = np.array(eye.forward), np.array(eye.up)
            axes = np.stack([np.cross(forward, up), up, -forward], axis=1)
            eye.pos[:] = eye.pos + axes @ offset
            eye.forward[:], eye.up[:] = -axes @ turn[:, 2], axes @ turn[:, 1]


def _direction(rng: np.random.Generator) -> NDArray[np.float64]:
    """A direction, any as likely as any other ``(3,)``."""
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))
