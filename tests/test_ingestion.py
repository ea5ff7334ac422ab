"""Good logs become demonstrations without idle steps; bad ones are rejected with the reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.config import parse_config
from juicer.episode import Episode, Outcome, Source
from juicer.errors import ConfigError, RejectedLog
from juicer.ingestion import IngestionConfig, Rejection, ingest, ingest_log, steps_to_keep
from juicer.sim.env import AssemblyEnv
from juicer.teleoperation.log import OperatorLog, write_log

CONFIG = IngestionConfig(task="one_leg")
LENGTH = 80
STATE_SIZE = len(AssemblyEnv("one_leg").get_state())


def log_with(**changes: object) -> OperatorLog:
    """A flawless log but for the fields given."""
    action = np.tile(np.array([0.5, 0.0, 0.1, 1, 0, 0, 0, -1, 0, -1.0], dtype=np.float32), (LENGTH, 1))
    action[:, 0] += np.linspace(0, 0.1, LENGTH)
    steps = {
        "proprioception": np.zeros((LENGTH, 16), np.float32),
        "part_poses": np.zeros((LENGTH, 35), np.float32),
        "sim_state": np.arange(float(LENGTH * STATE_SIZE)).reshape(LENGTH, STATE_SIZE),
        "action": action,
        "reward": np.zeros(LENGTH, np.float32),
    }
    fields = {
        "task": "one_leg",
        "randomness": "low",
        "seed": 3,
        "device": "test rig",
        "success": True,
        "outcome": "success",
        "parts_assembled": 1,
        "steps": steps | changes.pop("steps", {}),  # type: ignore[operator]
        "final": {name: steps[name][-1] for name in ("proprioception", "part_poses", "sim_state")},
        "timestamp_s": np.arange(LENGTH) * 0.1,
        "idle": np.zeros(LENGTH, bool),
        "milestones": {"leg_lifted": 40},
    }
    return OperatorLog(**(fields | changes))  # type: ignore[arg-type]


def idle_at(*steps: int) -> NDArray[np.bool_]:
    idle = np.zeros(LENGTH, bool)
    idle[list(steps)] = True
    return idle


def test_a_good_log_becomes_a_demonstration_with_its_facts():
    episode = ingest_log(log_with(), CONFIG)
    record = episode.record
    assert len(episode) == LENGTH
    assert (record.source, record.outcome, record.seed) == (Source.TELEOP, Outcome.SUCCESS, 3)
    assert (record.device, record.parts_assembled, record.milestones) == ("test rig", 1, {"leg_lifted": 40})


def test_idle_steps_are_dropped_and_the_rest_stays_aligned():
    log = log_with(idle=idle_at(5, 6, 7, 50))
    episode = ingest_log(log, CONFIG)
    kept = np.delete(np.arange(LENGTH), [5, 6, 7, 50])
    assert len(episode) == LENGTH - 4
    for name in ("action", "sim_state"):
        np.testing.assert_array_equal(episode.steps[name], log.steps[name][kept])
    assert episode.record.milestones == {"leg_lifted": 37}


def actions_with(gripper: NDArray[np.float64]) -> NDArray[np.float64]:
    actions = np.zeros((len(gripper), 10))
    actions[:, -1] = gripper
    return actions


def test_steps_after_a_gripper_toggle_stay_even_if_idle():
    gripper = np.full(40, -1.0)
    gripper[10:] = 1.0
    keep = steps_to_keep(actions_with(gripper), np.ones(40, bool), kept_after_toggle=12)
    np.testing.assert_array_equal(np.flatnonzero(keep), np.arange(10, 23))


def test_opening_an_open_gripper_or_a_tiny_command_is_no_toggle():
    gripper = np.array([-1.0, 0.01, -0.01, -1.0, 0.0])
    assert not steps_to_keep(actions_with(gripper), np.ones(5, bool), kept_after_toggle=12).any()


def test_reward_of_a_dropped_step_goes_to_the_step_before():
    reward = np.zeros(LENGTH, np.float32)
    reward[61] = 1.0
    episode = ingest_log(log_with(idle=idle_at(60, 61, 62), steps={"reward": reward}), CONFIG)
    assert np.flatnonzero(episode.steps["reward"]).tolist() == [59]
    assert episode.steps["reward"].sum() == 1.0


def test_a_milestone_in_the_idle_tail_stays_inside_the_episode():
    log = log_with(idle=idle_at(77, 78, 79), milestones={"screwed": 79})
    episode = ingest_log(log, CONFIG)
    assert episode.record.milestones == {"screwed": len(episode) - 1}


def broken(array: str, index: tuple[int, ...], value: float) -> dict[str, NDArray[np.generic]]:
    values = np.array(log_with().steps[array])
    values[index] = value
    return {array: values}


BAD_LOGS = {
    "shows task 'lamp'": {"task": "lamp"},
    "marked it as failed": {"success": False},
    "environment ended it as 'timeout'": {"outcome": "timeout"},
    "environment ended it as 'None'": {"outcome": None},
    "'proprioception' holds NaN or infinite values, first at step 9": {
        "steps": broken("proprioception", (9, 2), np.nan)
    },
    "'action' holds NaN": {"steps": broken("action", (0, 0), np.inf)},
    "'sim_state' holds NaN": {"steps": broken("sim_state", (4, 1), np.nan)},
    "step 11 leaves the range": {"steps": broken("action", (11, 2), 1.5)},
    "no pose": {"steps": broken("action", (slice(20, 21), slice(3, 9)), 0.0)},
    r"must have the shape \(80, 35\)": {"steps": {"part_poses": np.zeros((LENGTH, 21), np.float32)}},
    "'idle' has 79 steps": {"idle": np.zeros(LENGTH - 1, bool)},
    "'reward' has 10 steps": {"steps": {"reward": np.zeros(10, np.float32)}},
    "'idle' must have the shape": {"idle": np.zeros((LENGTH, 2), bool)},
    "do not increase after step 30": {"timestamp_s": np.r_[np.arange(31), np.arange(30, LENGTH - 1)] * 0.1},
    "3.00 s pass after step 39": {"timestamp_s": np.arange(LENGTH) * 0.1 + 2.9 * (np.arange(LENGTH) > 39)},
    "only 40 of its steps are not idle": {"idle": np.arange(LENGTH) >= 40},
    "unknown randomness 'lo'; did you mean 'low'": {"randomness": "lo"},
    "seed 3000001 must not be used for demonstrations; its seeds are 0 to 999999": {"seed": 3_000_001},
    "seed -1 must not be used for demonstrations": {"seed": -1},
    "counts 7 assembled pairs of the task's 1": {"parts_assembled": 7},
    rf"shape \({STATE_SIZE + 1},\) where those of the task's scene have {STATE_SIZE} entries": {
        "steps": {"sim_state": np.zeros((LENGTH, STATE_SIZE + 1))}
    },
    "final 'sim_state'": {
        "final": {"proprioception": np.zeros(16), "part_poses": np.zeros(35), "sim_state": np.zeros(5)}
    },
}


@pytest.mark.parametrize(("reason", "changes"), BAD_LOGS.items(), ids=list(BAD_LOGS))
def test_a_bad_log_is_rejected_with_the_reason(reason: str, changes: dict[str, object]):
    with pytest.raises(RejectedLog, match=reason):
        ingest_log(log_with(**changes), CONFIG)


def test_an_empty_log_is_rejected():
    empty = {name: values[:0] for name, values in log_with().steps.items()}
    with pytest.raises(RejectedLog, match="no steps"):
        ingest_log(log_with(steps=empty, idle=np.zeros(0, bool), timestamp_s=np.zeros(0)), CONFIG)


def test_files_are_ingested_one_by_one_and_bad_ones_do_not_stop_the_rest(tmp_path: Path):
    write_log(tmp_path / "a.npz", log_with())
    (tmp_path / "b.npz").write_bytes(b"garbage")
    write_log(tmp_path / "c.npz", log_with(success=False))
    write_log(tmp_path / "d.npz", log_with(seed=11))
    reports: list[tuple[int, int]] = []
    results = list(ingest(sorted(tmp_path.iterdir()), CONFIG, lambda done, total, **_: reports.append((done, total))))
    assert [type(result) for result in results] == [Episode, Rejection, Rejection, Episode]
    assert [result.source for result in results if isinstance(result, Rejection)] == ["b.npz", "c.npz"]
    assert reports == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_a_log_of_another_scene_is_named_and_the_others_go_on(tmp_path: Path):
    other = np.zeros((LENGTH, STATE_SIZE - 5))
    final = {**log_with().final, "sim_state": other[-1]}
    write_log(tmp_path / "a.npz", log_with(steps={"sim_state": other}, final=final))
    write_log(tmp_path / "b.npz", log_with())
    rejection, episode = ingest(sorted(tmp_path.iterdir()), CONFIG)
    assert isinstance(rejection, Rejection)
    assert isinstance(episode, Episode)
    assert rejection.source == "a.npz"
    assert "another scene" in rejection.reason


def test_an_unknown_task_is_a_config_error():
    with pytest.raises(ConfigError, match="task: unknown task 'one_lag'; did you mean 'one_leg'"):
        parse_config({"task": "one_lag"}, IngestionConfig, origin="test")
