"""An operator takes over from a policy that got stuck."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from juicer.demonstration.correction import Correction, CorrectionConfig, correct, take_over, takeover_step
from juicer.demonstration.log import OperatorLog
from juicer.demonstration.operator import OperatorStep
from juicer.episode import Episode, EpisodeRecord, Outcome, Source
from juicer.expert.operator import scripted_operators
from juicer.sim.env import AssemblyEnv
from juicer.sim.recorder import EpisodeRecorder
from juicer.tasks.specification import AssemblyTask
from tests.conftest import EpisodeFactory
from tests.reader import Reader

CONFIG = CorrectionConfig(corrections=1, patience_steps=10, lead_steps=5)
STUCK_FROM = 20


@pytest.fixture(scope="module")
def stuck(recording: OperatorLog) -> Episode:
    """A rollout that lifts the leg, and then does nothing more."""
    lifted = recording.milestones["leg_lifted"]
    env = AssemblyEnv("one_leg")
    env.reset(seed=recording.seed)
    recorder = EpisodeRecorder(env)
    for action in recording.steps["action"][: lifted + 1]:
        recorder.step(action)
    for _ in range(STUCK_FROM):
        recorder.step(recording.steps["action"][lifted])
    record = EpisodeRecord(
        source=Source.ROLLOUT,
        task="one_leg",
        randomness="low",
        seed=recording.seed,
        outcome=Outcome.TIMEOUT,
        milestones=recorder.info["milestones"],
    )
    return recorder.episode(record)


@pytest.fixture(scope="module")
def correction(stuck: Episode) -> Correction:
    (attempt,) = correct(Reader([stuck]), scripted_operators(), CONFIG, num_workers=1)
    return attempt


def test_the_operator_finishes_what_the_policy_has_begun(correction: Correction):
    record = correction.episode.record
    assert (record.outcome, record.source, record.parts_assembled) == (Outcome.SUCCESS, Source.CORRECTION, 1)
    assert correction.milestone == "leg_lifted"


def test_a_correction_tells_from_which_step_of_which_rollout_it_was_grown(correction: Correction, stuck: Episode):
    record = correction.episode.record
    assert record.parent == stuck.record.episode_id
    assert record.parent_step == stuck.record.milestones["leg_lifted"] + CONFIG.patience_steps
    np.testing.assert_array_equal(correction.episode.state(0), stuck.state(record.parent_step))


def test_what_the_policy_had_reached_before_is_no_milestone_of_the_operator(correction: Correction):
    milestones = correction.episode.record.milestones
    assert "leg_lifted" not in milestones
    assert 0 < milestones["leg_inserted"] <= milestones["leg_screwed"] < len(correction.episode)


def test_idle_steps_are_left_out_but_count_as_a_human_s_time(correction: Correction):
    assert len(correction.episode) <= correction.human_steps
    assert correction.episode.recorded_step(len(correction.episode)) <= correction.human_steps


def test_a_correction_depends_on_its_rollout_alone(correction: Correction, stuck: Episode):
    env = AssemblyEnv("one_leg", max_steps=10**9)
    again = take_over(env, stuck, scripted_operators(), CONFIG)
    assert again.episode.record == correction.episode.record


class Idler:
    """Leaves the device alone."""

    device = "none"
    idle = False

    def __init__(self, task: AssemblyTask, seed: int) -> None:
        self._action = np.array([0.5, 0, 0.3, 1, 0, 0, 0, -1, 0, 1.0])

    def act(self, observation: object) -> OperatorStep:
        return OperatorStep(self._action, idle=self.idle)


class AbsentOperator(Idler):
    """Says so, too."""

    idle = True


def test_a_gripper_that_is_closed_at_the_beginning_is_no_reason_to_keep_idle_steps(stuck: Episode):
    env = AssemblyEnv("one_leg", max_steps=10**9)
    attempt = take_over(env, stuck, AbsentOperator, CONFIG.model_copy(update={"max_steps": 20}))
    assert len(attempt.episode) == 1


def test_an_operator_who_gets_nowhere_gives_up(stuck: Episode):
    config = CONFIG.model_copy(update={"max_steps": 4, "max_attempts_per_correction": 2})
    others = [replace(stuck, record=replace(stuck.record, episode_id=name)) for name in "abc"]
    attempts = list(correct(Reader(others), Idler, config, num_workers=2))
    assert [attempt.episode.record.parent for attempt in attempts] == ["a", "b"]
    assert {attempt.episode.record.outcome for attempt in attempts} == {Outcome.TIMEOUT}
    assert {attempt.human_steps for attempt in attempts} == {4}


def test_successful_and_diverged_rollouts_are_left_alone(stuck: Episode):
    others = [replace(stuck.record, outcome=outcome) for outcome in (Outcome.SUCCESS, Outcome.DIVERGED)]
    episodes = [replace(stuck, record=record) for record in others]
    assert list(correct(Reader(episodes), scripted_operators(), CONFIG)) == []


@pytest.mark.parametrize(
    ("length", "milestones", "step"),
    [
        (100, {}, 10),
        (100, {"top_placed": 30, "leg_lifted": 50}, 60),
        (58, {"leg_lifted": 50}, 53),
        (4, {}, 0),
    ],
    ids=["nothing reached", "stuck after a milestone", "lost soon after it", "hardly begun"],
)
def test_an_onlooker_waits_after_the_last_milestone_and_steps_in_before_the_end(
    episode_factory: EpisodeFactory, length: int, milestones: dict[str, int], step: int
):
    rollout = episode_factory(length, outcome=Outcome.TIMEOUT, milestones=milestones)
    assert takeover_step(rollout, CONFIG) == step
