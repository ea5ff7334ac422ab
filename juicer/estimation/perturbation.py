"""Recorded states, displaced: gripper and parts a little elsewhere than where they stood, with their exact poses.

Nothing is simulated. Parts may overlap, or hover by a hair: that costs an estimator nothing, which must only tell where
they are, and sees more of what a policy may come upon than demonstrations show.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.displacements import Displacements
from juicer.geometry import (
    matrix_to_quat,
    quat_multiply,
    quat_to_matrix,
    relative_pose,
    rotvec_to_matrix,
)
from juicer.sim.controller import EndEffectorController
from juicer.sim.env import AssemblyEnv
from juicer.sim.views import SceneViews
from juicer.tasks.specification import MOUNTED_COSINE, AssemblyPair

_ASIDE_M, _ABOVE_M = 0.008, 0.03
"""A part so near to its seat's axis, and no higher above the seat, stands in its hole."""

Array = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Scene:
    """A displaced state.

    Attributes:
        positions: Positions of all joints ``(nq,)``, from which the scene can be drawn.
        proprioception: ``(16,)``; velocities are those of the recorded state.
        part_poses: ``(7 P,)``, robot base frame.
    """

    positions: Array
    proprioception: NDArray[np.float32]
    part_poses: NDArray[np.float32]


class Perturbation:
    """Displaces recorded states of one task."""

    def __init__(self, task: str, config: Displacements) -> None:
        """Build the scene."""
        self._config = config
        self._env = AssemblyEnv(task)
        self._views = SceneViews(self._env.model, self._env.data, self._env.task)
        self._controller = EndEffectorController()

    def displace(self, state: NDArray[np.float64], rng: np.random.Generator) -> Scene:
        """A recorded simulator state, displaced.

        Raises:
            InvalidEpisode: If it is no state of the task's scene.
        """
        env, config = self._env, self._config
        env.set_state(state)
        poses = self._views.part_poses.reshape(-1, 7)
        recorded = poses.copy()
        held, standing_in = self._held(), self._standing_in(recorded)

        def level(largest: float) -> float:
            return largest * float(rng.random()) ** 2

        planar = _motion(rng, level(config.base_m), level(config.base_rad), planar=True)
        base = recorded[0, :3]
        carried = self._carried(standing_in)
        for part in carried:
            poses[part] = _moved(recorded[part], planar, base)
        if held in carried:
            # It is pushed along the table or stands in its hole: the gripper goes with it, and slips.
            self._move_gripper(planar, base)
            self._move_gripper(_motion(rng, level(config.slip_m), level(config.slip_rad)))
        else:
            moved = self._move_gripper(_motion(rng, level(config.gripper_m), level(config.gripper_rad)))
            if held is not None:
                poses[held] = _moved(recorded[held], *moved)
        if held:
            slip = _motion(rng, level(config.slip_m), level(config.slip_rad))
            poses[held] = _moved(poses[held], slip, self._views.position)
        for part in range(1, len(poses)):
            if part != held and part not in carried:
                shift = _motion(rng, level(config.part_m), level(config.part_rad), planar=True)
                poses[part] = _moved(recorded[part], shift, recorded[part, :3])
        mujoco.mj_kinematics(env.model, env.data)
        seen = env.observation()
        return Scene(env.data.qpos.copy(), seen["proprioception"], seen["part_poses"])

    def _held(self) -> int | None:
        """The part between the fingers, if there is one."""
        touching = self._env.contact_pairs()
        names = [part.name for part in self._env.task.parts]
        held = [number for number, name in enumerate(names) if ("gripper", name) in touching]
        return held[-1] if held else None

    def _standing_in(self, poses: Array) -> dict[int, int]:
        """Of every part that stands in its hole, in which part."""
        return {
            pair.second: pair.first
            for pair in self._env.task.pairs
            if _stands_in(pair, relative_pose(poses[pair.first], poses[pair.second]))
        }

    def _carried(self, standing_in: dict[int, int]) -> set[int]:
        """The first part, and all that stands in it or in what does."""
        carried = {0}
        for second, first in standing_in.items():
            if first in carried:
                carried.add(second)
        return carried

    def _move_gripper(self, motion: _Motion, pivot: Array | None = None) -> tuple[_Motion, Array]:
        """Move the gripper as far as the arm reaches; what motion that was, and about which point."""
        views, env = self._views, self._env
        before, turned = views.position.copy(), env.data.site_xmat[views.site].reshape(3, 3).copy()
        about = before if pivot is None else pivot
        position = about + motion.matrix @ (before - about) + motion.shift
        views.joints[:] = self._controller.joints_at(position, motion.matrix @ turned, views.joints)
        mujoco.mj_kinematics(env.model, env.data)
        matrix = env.data.site_xmat[views.site].reshape(3, 3) @ turned.T
        return _Motion(matrix, views.position - before), before


@dataclass(frozen=True)
class _Motion:
    """A rotation about a point that is named where it is applied, and a shift; robot base frame."""

    matrix: Array
    shift: Array


def _motion(rng: np.random.Generator, distance_m: float, angle_rad: float, *, planar: bool = False) -> _Motion:
    """A random motion; a planar one slides along the table."""
    turn, shift = rng.normal(0, angle_rad, 3), rng.normal(0, distance_m, 3)
    if planar:
        turn[:2], shift[2] = 0, 0
    return _Motion(rotvec_to_matrix(turn), shift)


def _moved(pose: Array, motion: _Motion, pivot: Array) -> Array:
    position = pivot + motion.matrix @ (pose[:3] - pivot) + motion.shift
    return np.concatenate([position, quat_multiply(matrix_to_quat(motion.matrix), pose[3:])])


def _stands_in(pair: AssemblyPair, seen: Array) -> bool:
    for target in np.array(pair.targets):
        axis = quat_to_matrix(target[3:])[:, 1]
        offset = seen[:3] - target[:3]
        height = float(offset @ axis)
        aside = float(np.linalg.norm(offset - height * axis))
        is_upright = float(quat_to_matrix(seen[3:])[:, 1] @ axis) >= MOUNTED_COSINE
        if aside < _ASIDE_M and abs(height) < _ABOVE_M and is_upright:
            return True
    return False
