from __future__ import annotations

import numpy as np
import pytest

from juicer.augmentation.config import AugmentationConfig
from juicer.augmentation.reference import Reference
from juicer.augmentation.verify import RejectionReason, deviation_from_reference, outcome_rejection
from juicer.episode import Episode, Outcome
from juicer.geometry import axis_rotation, matrix_to_quat, quat_multiply

CONFIG = AugmentationConfig()
CRITICAL_STEP = 16


@pytest.fixture
def snippet(insertions: list[Episode], reference: Reference) -> Episode:
    """A copy of the reference's own demonstration from the critical state to the end of the reference."""
    end = CRITICAL_STEP + len(reference.actions)
    demonstration = insertions[0]
    return Episode(
        demonstration.record,
        {name: values[CRITICAL_STEP:end].copy() for name, values in demonstration.steps.items()},
        {name: demonstration.steps[name][end].copy() for name in demonstration.final},
    )


@pytest.fixture
def change(snippet: Episode, reference: Reference) -> int:
    """Step of the snippet at which the gripper's command changes."""
    return len(snippet) - reference.change.remaining


def test_the_demonstration_itself_matches(snippet: Episode, reference: Reference, change: int):
    assert deviation_from_reference(snippet, reference, CONFIG) is None
    assert snippet.steps["action"][change - 1, 9] > 0 > snippet.steps["action"][change, 9]


@pytest.mark.parametrize("part", range(5))
def test_every_part_must_be_where_it_was_when_the_gripper_changes(
    snippet: Episode, reference: Reference, change: int, part: int
):
    snippet.steps["part_poses"][change, 7 * part + 1] += 0.0015
    assert deviation_from_reference(snippet, reference, CONFIG) is None
    snippet.steps["part_poses"][change, 7 * part + 1] += 0.001
    assert deviation_from_reference(snippet, reference, CONFIG) is RejectionReason.PART_POSITION


def test_what_was_let_go_may_lean_at_the_end(snippet: Episode, reference: Reference):
    snippet.final["part_poses"][28] += 0.012
    assert deviation_from_reference(snippet, reference, CONFIG) is None
    snippet.final["part_poses"][28] += 0.006
    assert deviation_from_reference(snippet, reference, CONFIG) is RejectionReason.PART_POSITION


@pytest.mark.parametrize(("angle_deg", "reason"), [(18, None), (22, RejectionReason.PART_ROTATION)])
def test_a_part_must_not_have_turned(
    snippet: Episode, reference: Reference, angle_deg: float, reason: RejectionReason | None
):
    turn = matrix_to_quat(axis_rotation("z", np.radians(angle_deg)))
    snippet.final["part_poses"][31:35] = quat_multiply(turn, snippet.final["part_poses"][31:35])
    assert deviation_from_reference(snippet, reference, CONFIG) is reason


def test_the_gripper_must_be_as_open_as_it_was(snippet: Episode, reference: Reference):
    snippet.final["proprioception"][15] -= 0.006
    assert deviation_from_reference(snippet, reference, CONFIG) is RejectionReason.GRIPPER_WIDTH


def test_an_early_end_is_a_reason():
    assert outcome_rejection(Outcome.DIVERGED) is RejectionReason.DIVERGED
    assert outcome_rejection(Outcome.PART_LOST) is RejectionReason.PART_LOST
