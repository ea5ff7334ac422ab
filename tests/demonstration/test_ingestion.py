"""Good logs become demonstrations without idle steps; bad ones are rejected with the reason."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.config import parse_config
from juicer.demonstration.ingestion import Demonstration, Ingestion, IngestionConfig, UnusableLog, ingest, steps_to_keep
from juicer.demonstration.log import OperatorLog, write_log
from juicer.episode import Outcome, Source
from juicer.errors import ConfigError, RejectedLog
from juicer.sim.env import AssemblyEnv

CONFIG = IngestionConfig(task="one_leg")
AT_ONCE = IngestionConfig(task="one_leg", kept_after_toggle=0)
LogFactory = Callable[..., OperatorLog]


@pytest.fixture
def log_with(recording: OperatorLog) -> LogFactory:
    """A real recording but for the fields given; the operator of it is never idle."""

    def make(**changes: Any) -> OperatorLog:
        idle = np.zeros(len(recording), bool)
        steps = {**recording.steps, **changes.pop("steps", {})}
        final = {**recording.final, **changes.pop("final", {})}
        return replace(recording, **{"idle": idle, "steps": steps, "final": final, **changes})

    return make


def ingest_log(log: OperatorLog, config: IngestionConfig = CONFIG) -> Demonstration:
    return Ingestion(config).ingest_log(log)


def idle_at(log: OperatorLog, *steps: int) -> NDArray[np.bool_]:
    idle = np.zeros(len(log), bool)
    idle[list(steps)] = True
    return idle


def test_a_good_log_becomes_a_demonstration_with_its_facts(log_with: LogFactory):
    log = log_with()
    demonstration = ingest_log(log)
    record = demonstration.episode.record
    assert len(demonstration.episode) == demonstration.num_steps == len(log)
    assert (record.source, record.outcome, record.seed) == (Source.TELEOP, Outcome.SUCCESS, log.seed)
    assert (record.device, record.parts_assembled) == (log.device, 1)
    assert record.milestones["leg_lifted"] == log.milestones["leg_lifted"]


def test_idle_steps_are_dropped_and_the_rest_stays_aligned(log_with: LogFactory):
    log = log_with()
    demonstration = ingest_log(replace(log, idle=idle_at(log, 5, 6, 7, 20)))
    kept = np.delete(np.arange(len(log)), [5, 6, 7, 20])
    np.testing.assert_array_equal(demonstration.kept, kept)
    for name in ("action", "sim_state"):
        np.testing.assert_array_equal(demonstration.episode.steps[name], log.steps[name][kept])
    assert demonstration.episode.record.milestones["leg_lifted"] == log.milestones["leg_lifted"] - 4


def test_a_demonstration_replays_bit_for_bit_exactly_where_it_says_so(log_with: LogFactory):
    log = log_with()
    episode = ingest_log(replace(log, idle=idle_at(log, 0, 10, 20, 21))).episode
    continuous = episode.steps["continuous"]
    assert np.flatnonzero(~continuous).tolist() == [8, 17]
    np.testing.assert_array_equal(episode.steps["recorded_step"], np.delete(np.arange(len(log)), [0, 10, 20, 21]))
    env = AssemblyEnv("one_leg")
    for step in (7, 8, 9, 17, 18, len(episode) - 1):
        env.set_state(episode.state(step))
        env.step(episode.steps["action"][step])
        assert np.array_equal(env.get_state(), episode.state(step + 1)) == continuous[step]


def test_a_dropped_tail_is_marked_too(log_with: LogFactory):
    log = log_with()
    episode = ingest_log(replace(log, idle=idle_at(log, len(log) - 1)), AT_ONCE).episode
    assert np.flatnonzero(~episode.steps["continuous"]).tolist() == [len(episode) - 1]


def test_the_same_log_has_the_same_id_whatever_is_dropped_of_it_and_whatever_its_name(
    log_with: LogFactory, tmp_path: Path
):
    log = replace(log_with(), idle=idle_at(log_with(), 5, 6, 7))
    write_log(tmp_path / "a.npz", log)
    write_log(tmp_path / "b.npz", replace(log, device="another hand"))
    ids = set()
    for name, config in (("a.npz", CONFIG), ("a.npz", AT_ONCE), ("b.npz", CONFIG)):
        (demonstration,) = ingest([tmp_path / name], config)
        assert isinstance(demonstration, Demonstration)
        assert demonstration.episode.record.log == name
        ids.add(demonstration.episode.record.episode_id)
    assert len(ids) == 1


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


@pytest.mark.parametrize(("closed_before", "kept"), [(20, 0), (5, 8)])
def test_a_gripper_that_closed_before_a_correction_is_no_toggle_of_it(closed_before, kept):
    before, after = actions_with([-1.0] * 3 + [1.0] * closed_before), actions_with([1.0] * 40)
    keep = steps_to_keep(after, np.ones(40, bool), 12, before)
    assert (len(keep), keep.sum(), keep[:kept].all()) == (40, kept, True)


def test_reward_of_a_dropped_step_goes_to_the_step_before(log_with: LogFactory):
    log = log_with()
    last = len(log) - 1
    assert log.steps["reward"][last] == 1.0
    episode = ingest_log(replace(log, idle=idle_at(log, last - 1, last)), AT_ONCE).episode
    assert np.flatnonzero(episode.steps["reward"]).tolist() == [last - 2]
    assert episode.steps["reward"].sum() == 1.0


def test_a_milestone_in_the_idle_tail_stays_inside_the_episode(log_with: LogFactory):
    log = log_with()
    episode = ingest_log(replace(log, idle=idle_at(log, len(log) - 2, len(log) - 1)), AT_ONCE).episode
    assert log.milestones["leg_screwed"] == len(log)
    assert episode.record.milestones["leg_screwed"] == len(episode) - 1


def broken(array: str, index: Any, value: float) -> Callable[[OperatorLog], dict[str, Any]]:
    def change(log: OperatorLog) -> dict[str, Any]:
        values = np.array(log.steps[array])
        values[index] = value
        return {"steps": {array: values}}

    return change


def with_steps(**arrays: Callable[[NDArray[Any]], NDArray[Any]]) -> Callable[[OperatorLog], dict[str, Any]]:
    return lambda log: {"steps": {name: change(log.steps[name]) for name, change in arrays.items()}}


Change = Mapping[str, Any] | Callable[[OperatorLog], dict[str, Any]]
BAD_LOGS: dict[str, Change] = {
    "shows task 'lamp'": {"task": "lamp"},
    "marked it as failed": {"success": False},
    "environment ended it as 'timeout'": {"outcome": "timeout"},
    "environment ended it as 'None'": {"outcome": None},
    "'proprioception' holds NaN or infinite values, first at step 9": broken("proprioception", (9, 2), np.nan),
    "'action' holds NaN": broken("action", (0, 0), np.inf),
    "'sim_state' holds NaN": broken("sim_state", (4, 1), np.nan),
    "'timestamp_s' holds NaN": lambda log: {"timestamp_s": np.where(np.arange(len(log)) == 3, np.inf, 0.0)},
    "step 11 leaves the range": broken("action", (11, 2), 1.5),
    "does not encode a pose": broken("action", (slice(20, 21), slice(3, 9)), 0.0),
    r"'part_poses' must have the shape \(\d+, 35\)": with_steps(part_poses=lambda poses: poses[:, :21]),
    "'idle' has 79 steps": {"idle": np.zeros(79, bool)},
    "'reward' has 10 steps": with_steps(reward=lambda reward: reward[:10]),
    "'idle' must have the shape": lambda log: {"idle": np.zeros((len(log), 2), bool)},
    "do not increase after step 30": lambda log: {
        "timestamp_s": 0.1 * (np.arange(len(log)) - (np.arange(len(log)) > 30))
    },
    "3.00 s pass after step 39": lambda log: {
        "timestamp_s": 0.1 * np.arange(len(log)) + 2.9 * (np.arange(len(log)) > 39)
    },
    "only 40 of its steps are not idle": lambda log: {
        "idle": np.arange(len(log)) >= 40,
        "steps": {"action": np.concatenate([log.steps["action"][:, :9], np.full((len(log), 1), -1.0)], axis=1)},
    },
    "unknown randomness 'lo'; did you mean 'low'": {"randomness": "lo"},
    "seed 3000001 must not be used for demonstrations; its seeds are 0 to 999999": {"seed": 3_000_001},
    "seed -1 must not be used for demonstrations": {"seed": -1},
    "counts 7 assembled pairs; a success has all 1 of the task's": {"parts_assembled": 7},
    "counts 0 assembled pairs": {"parts_assembled": 0},
    r"shape \(282,\) where those of the task's scene have 281 entries": with_steps(
        sim_state=lambda states: np.pad(states, ((0, 0), (0, 1)))
    ),
    "final 'sim_state'": {"final": {"sim_state": np.zeros(5)}},
    "final 'part_poses'": {"final": {"part_poses": np.full(35, np.nan)}},
}


@pytest.mark.parametrize(("reason", "change"), BAD_LOGS.items(), ids=list(BAD_LOGS))
def test_a_bad_log_is_rejected_with_the_reason(log_with: LogFactory, reason: str, change: Change):
    changes = change(log_with()) if callable(change) else dict(change)
    with pytest.raises(RejectedLog, match=reason):
        ingest_log(log_with(**changes))


def test_an_empty_log_is_rejected(log_with: LogFactory):
    empty = {name: values[:0] for name, values in log_with().steps.items()}
    with pytest.raises(RejectedLog, match="no steps"):
        ingest_log(log_with(steps=empty, idle=np.zeros(0, bool), timestamp_s=np.zeros(0)))


def test_files_are_ingested_one_by_one_and_bad_ones_do_not_stop_the_rest(
    log_with: LogFactory, second_recording: OperatorLog, tmp_path: Path
):
    write_log(tmp_path / "a.npz", log_with())
    (tmp_path / "b.npz").write_bytes(b"garbage")
    write_log(tmp_path / "c.npz", log_with(success=False))
    write_log(tmp_path / "d.npz", second_recording)
    (tmp_path / "e.npz").symlink_to(tmp_path / "nowhere")
    (tmp_path / "f.npz").mkdir()
    os.mkfifo(tmp_path / "g.npz")
    (tmp_path / "h.npz").symlink_to("/dev/zero")
    reports: list[tuple[int, int]] = []
    paths = sorted(tmp_path.iterdir())
    results = list(ingest(paths, CONFIG, lambda done, total, **_: reports.append((done, total))))
    assert [result.source for result in results if isinstance(result, Demonstration)] == ["a.npz", "d.npz"]
    assert {result.source: result.reason for result in results if isinstance(result, UnusableLog)} == {
        "b.npz": "the file is truncated or no operator log (File is not a zip file)",
        "c.npz": "the operator marked it as failed",
        "e.npz": "it is a link to a file that does not exist",
        "f.npz": "the file cannot be read: it is not a plain file",
        "g.npz": "the file cannot be read: it is not a plain file",
        "h.npz": "the file cannot be read: it is not a plain file",
    }
    assert reports == [(done, 8) for done in range(1, 9)]
    # Somebody sat at the failed recording too.
    assert [result.num_steps for result in results] == [
        len(log_with()),
        0,
        len(log_with()),
        len(second_recording),
        0,
        0,
        0,
        0,
    ]


def test_a_log_of_another_scene_is_named_and_the_others_go_on(log_with: LogFactory, tmp_path: Path):
    other = np.array(log_with().steps["sim_state"][:, :-5])
    write_log(tmp_path / "a.npz", log_with(steps={"sim_state": other}, final={"sim_state": other[-1]}))
    write_log(tmp_path / "b.npz", log_with())
    rejection, demonstration = ingest(sorted(tmp_path.iterdir()), CONFIG)
    assert isinstance(rejection, UnusableLog)
    assert isinstance(demonstration, Demonstration)
    assert rejection.source == "a.npz"
    assert "another scene" in rejection.reason


def test_a_recording_counts_once_whatever_its_name_and_its_header(log_with: LogFactory, tmp_path: Path):
    write_log(tmp_path / "a.npz", log_with())
    write_log(tmp_path / "b.npz", log_with(device="another hand", milestones={}))
    (tmp_path / "c.npz").write_bytes((tmp_path / "a.npz").read_bytes())
    first, *others = ingest(sorted(tmp_path.iterdir()), CONFIG)
    assert isinstance(first, Demonstration)
    assert [other.reason for other in others] == ["it is the same recording as 'a.npz'"] * 2
    assert [other.num_steps for other in others] == [0, 0]


def test_a_name_that_would_steer_a_terminal_is_escaped(tmp_path: Path):
    path = tmp_path / "\x1b[31mred\n.npz"
    path.write_bytes(b"")
    (rejection,) = ingest([path], CONFIG)
    assert rejection.source == r"\x1b[31mred\n.npz"


def test_an_unknown_task_is_a_config_error():
    with pytest.raises(ConfigError, match="task: unknown task 'one_lag'; did you mean 'one_leg'"):
        parse_config({"task": "one_lag"}, IngestionConfig, origin="test")
