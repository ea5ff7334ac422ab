"""The scripted operator assembles the real thing, and its recording is a human's log."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from juicer.demonstration.ingestion import Ingestion, IngestionConfig
from juicer.demonstration.log import OperatorLog, read_log
from juicer.demonstration.recording import minutes_of, record_demonstration, record_demonstrations, recordings
from juicer.errors import ConfigError
from juicer.expert.operator import DEVICE, ScriptedOperator, scripted_operators
from juicer.expert.steady import Steady
from juicer.gripper import gripper_commands
from juicer.seeding import stream
from juicer.sim.env import AssemblyEnv
from juicer.sim.scene import home_xy
from juicer.tasks.registry import get_task

HESITANT = Steady(hesitation=1.0)


@pytest.fixture(scope="module")
def log() -> OperatorLog:
    """One demonstration by an operator who hesitates wherever there is time to."""
    env = AssemblyEnv()
    return record_demonstration(env, ScriptedOperator(env.task, stream(0, "operator"), HESITANT), seed=1)


def test_the_operator_assembles_one_leg(log: OperatorLog):
    assert log.success
    assert log.device == DEVICE
    assert list(log.milestones) == list(get_task("one_leg").milestones)
    assert 200 < len(log) < 800


def test_idle_steps_repeat_the_last_action(log: OperatorLog):
    idle = np.flatnonzero(log.idle)
    assert len(idle) > 10
    np.testing.assert_array_equal(log.steps["action"][idle], log.steps["action"][idle - 1])


def test_the_operator_does_not_pause_while_the_gripper_moves(log: OperatorLog):
    toggles = np.flatnonzero(np.diff(gripper_commands(log.steps["action"]), prepend=-1.0))
    for toggle in toggles:
        assert not log.idle[toggle : toggle + 13].any()


def test_actions_stay_in_the_range_of_the_device(log: OperatorLog):
    assert np.abs(log.steps["action"]).max() <= 1.0
    assert set(np.unique(log.steps["action"][:, -1])) == {-1.0, 1.0}


def test_no_action_leads_the_hand_by_more_than_a_human_would(log: OperatorLog):
    lead = np.linalg.norm(log.steps["action"][:, :3] - log.steps["proprioception"][:, :3], axis=1)
    assert lead[~log.idle].max() < 0.035


def test_the_top_is_pushed_to_one_side_of_the_fence_after_the_other(log: OperatorLog):
    short_x, short_y = (home_xy(get_task("one_leg").parts[0]) - log.steps["part_poses"][:, :2]).T
    home = np.flatnonzero(np.maximum(short_x, short_y) < 0.004)[0]
    assert min(short_x[0], short_y[0]) > 0.02
    assert short_x[:home][short_y[:home] > 0.006].min() > 0.008


def test_the_recording_passes_ingestion_without_its_idle_steps(log: OperatorLog):
    episode = Ingestion(IngestionConfig(task="one_leg")).ingest_log(log).episode
    assert len(episode) == len(log) - np.count_nonzero(log.idle)
    assert episode.steps["reward"].sum() == 1.0


def test_recorded_actions_replay_to_the_recorded_states(log: OperatorLog):
    env = AssemblyEnv()
    env.reset(seed=log.seed)
    for step in range(80):
        np.testing.assert_array_equal(env.get_state(), log.steps["sim_state"][step])
        env.step(log.steps["action"][step])


def test_an_operator_needs_to_have_learned_the_task():
    task = get_task("one_leg")
    top = dataclasses.replace(task.parts[0], handling=None)
    with pytest.raises(ConfigError, match="has not learned 'one_leg': it cannot push 'square_table_top'"):
        ScriptedOperator(dataclasses.replace(task, parts=(top, *task.parts[1:])), np.random.default_rng(0))


def test_demonstrations_are_written_until_enough_succeed_whatever_the_workers(tmp_path: Path):
    for workers in (1, 2):
        (tmp_path / str(workers)).mkdir()
    reports: list[int] = []
    alone = record_demonstrations(
        tmp_path / "1",
        "one_leg",
        "low",
        range(5),
        scripted_operators(),
        successes=1,
        progress=lambda done, *_, **__: reports.append(done),
    )
    together = record_demonstrations(
        tmp_path / "2", "one_leg", "low", range(5), scripted_operators(), successes=1, workers=2
    )
    assert alone == together
    assert alone.successes == 1
    assert reports[-1] == 1
    first, second = sorted((tmp_path / "1").iterdir()), sorted((tmp_path / "2").iterdir())
    assert [path.name for path in first] == [path.name for path in second]
    assert first[-1].read_bytes() == second[-1].read_bytes()
    assert read_log(first[-1]).success
    logs = [read_log(path) for path in first]
    assert alone.recordings == len(logs)
    assert alone.steps == sum(map(len, logs))
    assert alone.idle_steps == sum(int(log.idle.sum()) for log in logs)


def test_operators_sit_for_a_tenth_of_a_second_a_step():
    assert minutes_of(6000) == 10.0


@pytest.mark.slow
@pytest.mark.parametrize("randomness", ["low", "med"])
def test_the_operator_hardly_ever_fails(randomness: str):
    successes = sum(
        log.success for log in recordings("one_leg", randomness, range(8000, 8020), scripted_operators(), workers=2)
    )
    assert successes >= 18
