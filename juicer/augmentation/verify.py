"""Believe a snippet only if it arrives where the demonstration was."""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np

from juicer.augmentation.config import ToleranceConfig
from juicer.augmentation.reference import Reference
from juicer.episode import Episode, Outcome
from juicer.geometry import quat_to_matrix, rotation_angle


class RejectionReason(StrEnum):
    """Why an attempt gave no snippet."""

    DROPPED = "dropped"
    PART_LOST = "part_lost"
    DIVERGED = "diverged"
    PART_POSITION = "part_position"
    PART_ROTATION = "part_rotation"
    GRIPPER_WIDTH = "gripper_width"
    NOT_REPRODUCED = "not_reproduced"


def outcome_rejection(outcome: Outcome) -> RejectionReason:
    """Why an attempt whose environment ended early gives no snippet."""
    return RejectionReason.DIVERGED if outcome is Outcome.DIVERGED else RejectionReason.PART_LOST


def deviation_from_reference(
    snippet: Episode, reference: Reference, tolerance: ToleranceConfig
) -> RejectionReason | None:
    """First way in which a snippet's end differs too much from the demonstration's; None if it matches.

    Every part counts, also those that should only have stayed where they were.
    """
    poses = np.asarray(snippet.final["part_poses"], dtype=np.float64).reshape(-1, 7)
    wanted = np.asarray(reference.part_poses, dtype=np.float64).reshape(-1, 7)
    if np.max(np.linalg.norm(poses[:, :3] - wanted[:, :3], axis=1)) > tolerance.position_m:
        return RejectionReason.PART_POSITION
    turned = rotation_angle(quat_to_matrix(wanted[:, 3:]), quat_to_matrix(poses[:, 3:]))
    if np.max(turned) > math.radians(tolerance.rotation_deg):
        return RejectionReason.PART_ROTATION
    width = float(snippet.final["proprioception"][15])
    if abs(width - reference.gripper_width_m) > tolerance.gripper_width_m:
        return RejectionReason.GRIPPER_WIDTH
    return None
