"""Believe a snippet only if it arrives where the demonstration was."""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np

from juicer.augmentation.config import AugmentationConfig, ToleranceConfig
from juicer.augmentation.reference import GRIPPER_WIDTH, Expected, Reference
from juicer.episode import Episode, Outcome
from juicer.geometry import quat_to_matrix, rotation_angle


class RejectionReason(StrEnum):
    """Why an attempt gave no snippet."""

    MISSED = "missed"
    DROPPED = "dropped"
    PART_LOST = "part_lost"
    DIVERGED = "diverged"
    PART_POSITION = "part_position"
    PART_ROTATION = "part_rotation"
    GRIPPER_WIDTH = "gripper_width"
    NOT_REPRODUCED = "not_reproduced"
    REPEATED = "repeated"


def outcome_rejection(outcome: Outcome) -> RejectionReason:
    """Why an attempt whose environment ended early gives no snippet."""
    return RejectionReason.DIVERGED if outcome is Outcome.DIVERGED else RejectionReason.PART_LOST


def deviation_from_reference(
    snippet: Episode, reference: Reference, config: AugmentationConfig
) -> RejectionReason | None:
    """First way in which a snippet differs too much from its demonstration; None if it matches.

    Compared twice: when the gripper's command changes, which shows the assembly itself, and at the end, which shows
    that it lasts. What is let go may lean this way or that, so the end is judged less strictly.

    Args:
        snippet: An episode whose last actions are the reference's.
        reference: What the demonstration did.
        config: How much difference is too much.
    """
    checks = ((reference.change, config.tolerance), (reference.end, config.end_tolerance))
    return next((reason for check in checks if (reason := _deviation(snippet, *check)) is not None), None)


def _deviation(snippet: Episode, wanted: Expected, tolerance: ToleranceConfig) -> RejectionReason | None:
    """Every part counts, also those that should only have stayed where they were."""
    shown = snippet.observation(len(snippet) - wanted.remaining)
    poses = np.asarray(shown["part_poses"], dtype=np.float64).reshape(-1, 7)
    wanted_poses = np.asarray(wanted.part_poses, dtype=np.float64).reshape(-1, 7)
    if np.max(np.linalg.norm(poses[:, :3] - wanted_poses[:, :3], axis=1)) > tolerance.position_m:
        return RejectionReason.PART_POSITION
    turned = rotation_angle(quat_to_matrix(wanted_poses[:, 3:]), quat_to_matrix(poses[:, 3:]))
    if np.max(turned) > math.radians(tolerance.rotation_deg):
        return RejectionReason.PART_ROTATION
    width = float(shown["proprioception"][GRIPPER_WIDTH])
    if abs(width - wanted.gripper_width_m) > tolerance.gripper_width_m:
        return RejectionReason.GRIPPER_WIDTH
    return None
