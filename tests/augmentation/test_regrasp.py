from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.augmentation.augment import FailedAttempt, Snippet, attempt_snippet, augment
from juicer.augmentation.config import AugmentationConfig, CoveragePlacement, GraspConfig, ToleranceConfig
from juicer.augmentation.execute import execute
from juicer.augmentation.plan import POSE_SIZE
from juicer.augmentation.reference import Reference, reference_of
from juicer.augmentation.regrasp import moved, regrasp
from juicer.augmentation.summary import AugmentationSummary
from juicer.augmentation.verify import RejectionReason, deviation_from_reference
from juicer.episode import Episode, EpisodeRecord, Outcome, Source
from juicer.geometry import quat_to_matrix, rot6d_to_matrix, rotation_angle
from juicer.seeding import stream
from juicer.sim.env import AssemblyEnv
from juicer.sim.recorder import EpisodeRecorder
from juicer.storage.annotations import Annotation
from tests.reader import Reader

LEG = 4
CRITICAL = 46
CONFIG = GraspConfig()
WITHIN_6_MM = ToleranceConfig(position_m=0.006)
ANY_END = ToleranceConfig(position_m=1.0, rotation_deg=360.0, gripper_width_m=1.0)


@pytest.fixture(scope="module")
def demonstration(insertions: list[Episode]) -> Episode:
    """A leg is let go in its hole and grasped there once more, to be taken out and put back."""
    env = AssemblyEnv("one_leg")
    env.set_state(insertions[0].state(33))
    last = insertions[0].steps["action"][24]
    up = np.array([0, 0, 0.06] + [0] * 7, dtype=np.float32)
    recorder = EpisodeRecorder(env)
    openings = [-1.0] * 12 + [1.0] * 56 + [-1.0] * 12
    heights = np.interp(np.arange(80), [0, 4, 20, 36, 46, 62], [0, 0.3, 0.3, 1, 1, 0.3])
    for height, opening in zip(heights, openings, strict=True):
        action = last + height * up
        action[9] = opening
        recorder.step(action)
    return recorder.episode(EpisodeRecord(Source.TELEOP, "one_leg", "low", 0, Outcome.SUCCESS))


@pytest.fixture(scope="module")
def grasped(demonstration: Episode) -> Reference:
    return reference_of(demonstration, CRITICAL, 0, steps_after_gripper_change=5)


def in_hand(env: AssemblyEnv, state: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position of the leg (m) and its axes in the gripper's frame."""
    env.set_state(state)
    shown = env.observation()
    leg, gripper = shown["part_poses"][7 * LEG :][:7].astype(np.float64), shown["proprioception"].astype(np.float64)
    frame = rot6d_to_matrix(gripper[3:POSE_SIZE])
    return frame.T @ (leg[:3] - gripper[:3]), frame.T @ quat_to_matrix(leg[3:])


def test_a_leg_is_held_elsewhere_and_still_goes_where_it_went(env: AssemblyEnv, grasped: Reference):
    position, axes = in_hand(env, grasped.state)
    places = []
    for seed in range(8):
        other = regrasp(env, grasped, CONFIG, stream(seed, "test"))
        assert isinstance(other, Reference)
        snippet = execute(env, other, np.empty((0, POSE_SIZE)))
        assert isinstance(snippet, Episode)
        assert deviation_from_reference(snippet, grasped, AugmentationConfig(tolerance=WITHIN_6_MM)) is None
        found, turned = in_hand(env, other.state)
        places.append([*(found - position), rotation_angle(axes, turned)])
    spread = np.ptp(np.array(places), axis=0)
    assert spread[0] > 0.004
    assert spread[2] > 0.002
    assert spread[1] < 0.001, "the fingers close around it"
    assert spread[3] > np.radians(2)


def test_what_is_moved_is_moved_in_the_grippers_own_frame(grasped: Reference):
    shift = np.array([0.004, 0.0, -0.002])
    actions = moved(grasped.actions, shift, np.eye(3))
    rotations = rot6d_to_matrix(grasped.actions[:, 3:POSE_SIZE])
    steps = np.einsum("tji,tj->ti", rotations, actions[:, :3] - grasped.actions[:, :3])
    np.testing.assert_allclose(steps, np.broadcast_to(shift, steps.shape), atol=1e-6)
    np.testing.assert_allclose(actions[:, 3:], grasped.actions[:, 3:], atol=1e-6)


def test_without_a_grasp_before_it_a_reference_stays_as_it_is(env: AssemblyEnv, reference: Reference):
    assert reference.grasp is None, "the leg is in the gripper from the start"
    assert regrasp(env, reference, CONFIG, stream(0, "test")) is reference


def test_a_grasp_that_misses_gives_no_snippet(env: AssemblyEnv, grasped: Reference):
    far = GraspConfig(shift_m=0.1, pitch_deg=0.0)
    tried = [regrasp(env, grasped, far, stream(seed, "test")) for seed in range(4)]
    assert RejectionReason.MISSED in tried


@pytest.mark.parametrize("outcome", [Outcome.DIVERGED, Outcome.PART_LOST])
def test_an_episode_that_ends_while_grasping_gives_no_snippet(
    grasped: Reference, outcome: Outcome, monkeypatch: pytest.MonkeyPatch
):
    env = AssemblyEnv("one_leg")
    monkeypatch.setattr(env, "_outcome", lambda parts_assembled: outcome)
    assert regrasp(env, grasped, CONFIG, stream(0, "test")) == outcome.value


def test_snippets_begin_with_the_other_grasp_if_one_is_wanted(env: AssemblyEnv, grasped: Reference):
    as_demonstrated = in_hand(env, grasped.state)[0]

    def farthest(config: AugmentationConfig) -> float:
        attempts = [attempt_snippet(env, grasped, config, stream(seed, "test")) for seed in range(6)]
        kept = [attempt.episode.state(0) for attempt in attempts if isinstance(attempt, Snippet)]
        return max(float(np.linalg.norm(in_hand(env, state)[0] - as_demonstrated)) for state in kept)

    assert farthest(AugmentationConfig(tolerance=ANY_END)) < 0.002
    assert farthest(AugmentationConfig(tolerance=ANY_END, grasp=CONFIG)) > 0.004


def test_snippets_with_other_grasps_lead_to_their_own_critical_poses_and_depend_on_the_seed_alone(
    demonstration: Episode,
):
    config = AugmentationConfig(
        num_snippets=3, grasp=CONFIG, placement=CoveragePlacement(), tolerance=ANY_END, end_tolerance=ANY_END
    )
    annotation = Annotation(demonstration.record.episode_id, CRITICAL, 0, "proposed", 1.0)

    def run(workers: int) -> list[Snippet]:
        attempts = augment(Reader([demonstration]), [annotation], config, seed=0, num_workers=workers)
        return [attempt for attempt in attempts if isinstance(attempt, Snippet)]

    snippets = run(1)
    assert [each.episode.record.episode_id for each in snippets] == [each.episode.record.episode_id for each in run(2)]
    assert len({each.reference.pose.tobytes() for each in snippets}) == 3
    for each in snippets:
        assert np.linalg.norm(each.way_back[-1, :3] - each.reference.pose[:3]) < 0.01


def test_a_failed_grasp_is_an_attempt(env: AssemblyEnv, grasped: Reference, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("juicer.augmentation.augment.regrasp", lambda *_: RejectionReason.MISSED)
    attempt = attempt_snippet(env, grasped, AugmentationConfig(grasp=CONFIG), stream(0, "test"))
    assert not isinstance(attempt, Snippet)
    assert (attempt.reason, attempt.critical_state) == (RejectionReason.MISSED, 0)
    assert attempt.parent == grasped.parent


def test_where_every_grasp_fails_the_sentence_names_its_setting():
    summary = AugmentationSummary(["insert leg"])
    list(summary.keep([FailedAttempt("0123/0", 0, "far", RejectionReason.MISSED)]))
    assert "'missed'" in summary.why_nothing(AugmentationConfig(grasp=CONFIG))
    assert "augment.grasp" in summary.why_nothing(AugmentationConfig(grasp=CONFIG))
    assert "augment.grasp" not in summary.why_nothing(AugmentationConfig())
