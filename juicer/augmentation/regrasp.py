"""Hold the part of a critical state a little differently than the demonstration did.

Few demonstrations show few ways to hold a part, so a policy that learns from them may align its gripper where it ought
to align the part. With another grasp, the same way of the part is another way of the gripper.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.augmentation.config import GraspConfig
from juicer.augmentation.execute import held_parts
from juicer.augmentation.plan import POSE_SIZE, admissible
from juicer.augmentation.reference import Reference
from juicer.augmentation.verify import RejectionReason, outcome_rejection
from juicer.geometry import axis_rotation, matrix_to_rot6d, rot6d_to_matrix
from juicer.sim.env import AssemblyEnv

Array = NDArray[np.floating[Any]]


def regrasp(
    env: AssemblyEnv, reference: Reference, config: GraspConfig, rng: np.random.Generator
) -> Reference | RejectionReason:
    """The reference as it would be, had its part been grasped elsewhere; the same if nothing is held there.

    The demonstration is carried out once more from just before that grasp, every pose of the end effector moved by one
    and the same step in the gripper's own frame: what is held goes the demonstrated way.

    Args:
        env: Environment of the reference's task without a step limit; its state is replaced.
        reference: Critical state of a demonstration.
        config: How far to move.
        rng: Source of the draw.

    Returns:
        The reference from where the demonstration's way led with that grasp, with the demonstration's ``phase`` and
        ``grasp``; or why it led nowhere.
    """
    if reference.grasp is None:
        return reference
    env.set_state(reference.state)
    if not (held := held_parts(env)):
        return reference
    shift = np.array([rng.uniform(-config.shift_m, config.shift_m), 0.0, rng.uniform(-config.shift_m, config.shift_m)])
    turn = axis_rotation("y", math.radians(rng.uniform(-config.pitch_deg, config.pitch_deg)))
    env.set_state(reference.grasp.state)
    for action in moved(reference.grasp.actions, shift, turn):
        observation, *_, info = env.step(action)
        if info["outcome"] is not None:
            return outcome_rejection(info["outcome"])
    if not held <= held_parts(env):
        return RejectionReason.MISSED
    return replace(
        reference,
        state=env.get_state(),
        pose=observation["proprioception"][:POSE_SIZE],
        actions=moved(reference.actions, shift, turn),
    )


def moved(actions: Array, shift: Array, turn: Array) -> NDArray[np.float32]:
    """Actions ``(T, 10)`` whose poses are shifted (m) and turned in the end effector's own frame."""
    rotations = rot6d_to_matrix(actions[:, 3:POSE_SIZE])
    positions = actions[:, :3] + rotations @ shift
    poses = admissible(np.concatenate([positions, matrix_to_rot6d(rotations @ turn)], axis=1))
    return np.concatenate([poses, actions[:, POSE_SIZE:]], axis=1).astype(np.float32)
