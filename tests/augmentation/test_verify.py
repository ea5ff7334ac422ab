from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from juicer.augmentation.config import ToleranceConfig
from juicer.augmentation.reference import Reference
from juicer.augmentation.verify import RejectionReason, deviation_from_reference, outcome_rejection
from juicer.episode import Episode, Outcome
from juicer.geometry import axis_rotation, matrix_to_quat, quat_multiply

TOLERANCE = ToleranceConfig()


@pytest.fixture
def snippet(insertions: list[Episode], reference: Reference) -> Episode:
    """Ends exactly like the reference."""
    final = dict(insertions[0].final)
    final["part_poses"] = reference.part_poses.copy()
    final["proprioception"] = final["proprioception"].copy()
    final["proprioception"][15] = reference.gripper_width_m
    return replace(insertions[0], final=final)


def test_the_same_end_matches(snippet: Episode, reference: Reference):
    assert deviation_from_reference(snippet, reference, TOLERANCE) is None


@pytest.mark.parametrize("part", range(5))
def test_every_part_must_be_where_it_was(snippet: Episode, reference: Reference, part: int):
    snippet.final["part_poses"][7 * part + 1] += 0.005
    assert deviation_from_reference(snippet, reference, TOLERANCE) is None
    snippet.final["part_poses"][7 * part + 1] += 0.002
    assert deviation_from_reference(snippet, reference, TOLERANCE) is RejectionReason.PART_POSITION


@pytest.mark.parametrize(("angle_deg", "reason"), [(18, None), (22, RejectionReason.PART_ROTATION)])
def test_a_part_must_not_have_turned(
    snippet: Episode, reference: Reference, angle_deg: float, reason: RejectionReason | None
):
    turn = matrix_to_quat(axis_rotation("z", np.radians(angle_deg)))
    snippet.final["part_poses"][31:35] = quat_multiply(turn, snippet.final["part_poses"][31:35])
    assert deviation_from_reference(snippet, reference, TOLERANCE) is reason


def test_the_gripper_must_be_as_open_as_it_was(snippet: Episode, reference: Reference):
    snippet.final["proprioception"][15] -= 0.006
    assert deviation_from_reference(snippet, reference, TOLERANCE) is RejectionReason.GRIPPER_WIDTH


def test_an_early_end_is_a_reason():
    assert outcome_rejection(Outcome.DIVERGED) is RejectionReason.DIVERGED
    assert outcome_rejection(Outcome.PART_LOST) is RejectionReason.PART_LOST
