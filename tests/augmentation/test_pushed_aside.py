"""The lamp's base stands loose on the table: a hood that leaves its seat can push it aside."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.annotation.propose import AnnotationConfig, propose
from juicer.augmentation.augment import FailedAttempt, Snippet, attempt_snippet
from juicer.augmentation.config import BESIDE, AugmentationConfig
from juicer.augmentation.reference import Reference, reference_of
from juicer.augmentation.verify import RejectionReason
from juicer.demonstration.ingestion import Ingestion, IngestionConfig
from juicer.demonstration.recording import record_demonstration
from juicer.episode import Episode
from juicer.expert.operator import ScriptedOperator
from juicer.geometry import relative_pose
from juicer.seeding import stream
from juicer.sim.env import AssemblyEnv

BASE, HOOD = 0, 2
INSERT_HOOD = 4


@pytest.fixture(scope="module")
def lamp() -> AssemblyEnv:
    return AssemblyEnv("lamp", max_steps=100_000)


@pytest.fixture(scope="module")
def demonstration(lamp: AssemblyEnv) -> Episode:
    log = record_demonstration(AssemblyEnv("lamp"), ScriptedOperator(lamp.task, stream(0, "operator", 0)), seed=0)
    episode = Ingestion(IngestionConfig(task="lamp")).ingest_log(log).episode
    assert episode is not None
    return episode


@pytest.fixture(scope="module")
def over_the_seat(lamp: AssemblyEnv, demonstration: Episode) -> Reference:
    found = propose(lamp, demonstration, AnnotationConfig())
    step = next(proposal.step for proposal in found if proposal.critical_state == INSERT_HOOD)
    return reference_of(demonstration, step, INSERT_HOOD, steps_after_gripper_change=5)


def hood_on_base(episode: Episode) -> NDArray[np.float64]:
    """Where the hood ends as seen from the base (m)."""
    poses = episode.observation(len(episode))["part_poses"].reshape(-1, 7).astype(np.float64)
    position: NDArray[np.float64] = relative_pose(poses[BASE], poses[HOOD])[:3]
    return position


def test_a_hood_that_pushed_its_seat_aside_is_not_learned_from(
    lamp: AssemblyEnv, demonstration: Episode, over_the_seat: Reference
):
    config = AugmentationConfig(departures={"beside": BESIDE})
    attempts = [attempt_snippet(lamp, over_the_seat, config, stream(seed, "test")) for seed in range(24)]
    kept = [attempt.episode for attempt in attempts if isinstance(attempt, Snippet)]
    reasons = [attempt.reason for attempt in attempts if isinstance(attempt, FailedAttempt)]
    assert kept
    assert RejectionReason.PART_POSITION in reasons
    seat = hood_on_base(demonstration)
    assert max(float(np.linalg.norm(hood_on_base(episode) - seat)) for episode in kept) < 0.003
