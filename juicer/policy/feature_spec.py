"""What a policy has to know of a task of ours."""

from __future__ import annotations

import math

import numpy as np

from juicer.geometry import Array, matrix_to_quat, quat_to_matrix
from juicer.policy.config import FeatureSpec, PairSpec, SymmetrySpec
from juicer.tasks.handling import BaseHandling, Handling
from juicer.tasks.registry import get_task
from juicer.tasks.specification import MOUNTED_COSINE, MOUNTED_M, AssemblyPair, AssemblyTask


def feature_spec(task_name: str) -> FeatureSpec:
    """The numbers of a task that its features need."""
    task = get_task(task_name)
    assembled = _assembled_rotations(task)
    return FeatureSpec(
        num_parts=len(task.parts),
        pairs=tuple(_pair_spec(task, pair, assembled.get(pair.second)) for pair in task.pairs),
        mounted_m=MOUNTED_M,
        mounted_cosine=MOUNTED_COSINE,
        symmetry=_symmetry_of_first(task),
    )


def _pair_spec(task: AssemblyTask, pair: AssemblyPair, assembled: Array | None) -> PairSpec:
    return PairSpec(
        first=pair.first,
        second=pair.second,
        target=pair.targets[pair.operator_target],
        also_at=tuple(target for index, target in enumerate(pair.targets) if index != pair.operator_target),
        any_rotation=pair.any_rotation,
        symmetry=_symmetry_in_gripper(task.parts[pair.second].handling, assembled),
    )


def _symmetry_of_first(task: AssemblyTask) -> SymmetrySpec | None:
    """None if something has its place beside the part's axis: the holes of a table top are told apart."""
    handling = task.parts[0].handling
    targets = [target for pair in task.pairs if pair.first == 0 for target in pair.targets]
    if not isinstance(handling, BaseHandling) or any(target[0] or target[2] for target in targets):
        return None
    return _symmetry(handling.symmetry_rad, np.array(handling.straight))


def _symmetry_in_gripper(handling: Handling | BaseHandling | None, assembled: Array | None) -> SymmetrySpec | None:
    """None if nobody knows how to screw the part, or if it is held at a ball, which lies flat nowhere."""
    if not isinstance(handling, Handling) or assembled is None or handling.is_ball:
        return None
    yaw = math.atan2(assembled[1, 0], assembled[0, 0]) + handling.flat_rad
    c, s = math.cos(yaw), math.sin(yaw)
    pointing_down = np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
    return _symmetry(handling.flat_every_rad, pointing_down.T @ assembled)


def _symmetry(every_rad: float, straight: Array) -> SymmetrySpec:
    w, x, y, z = matrix_to_quat(straight).tolist()
    return SymmetrySpec(every_rad=every_rad, straight=(w, x, y, z))


def _assembled_rotations(task: AssemblyTask) -> dict[int, Array]:
    """How parts are turned in the finished piece, by index, in the robot base frame, as far as that is known."""
    handling = task.parts[0].handling
    rotations = {0: np.array(handling.straight)} if isinstance(handling, BaseHandling) else {}
    for pair in task.pairs:
        if pair.first in rotations:
            on_first = quat_to_matrix(np.array(pair.targets[pair.operator_target][3:]))
            rotations[pair.second] = rotations[pair.first] @ on_first
    return rotations
