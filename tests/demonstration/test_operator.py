"""An operator with a device of its own: written here, outside the package, and recorded and ingested like any other."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.demonstration.ingestion import Demonstration, IngestionConfig, ingest
from juicer.demonstration.log import OperatorLog, read_log, write_log
from juicer.demonstration.operator import OperatorStep
from juicer.demonstration.recording import record_demonstration, recordings
from juicer.errors import InvalidAction
from juicer.sim.env import AssemblyEnv


class Keyboard:
    """Presses the keys that somebody pressed before, and rests now and then."""

    device = "keyboard"

    def __init__(self, actions: NDArray[Any], rests: tuple[int, ...] = ()) -> None:
        self._actions = actions
        self._rests = rests
        self._pressed = 0

    def act(self, observation: Mapping[str, NDArray[np.floating[Any]]]) -> OperatorStep:
        assert observation["proprioception"].shape == (16,)
        action = self._actions[min(self._pressed, len(self._actions) - 1)]
        self._pressed += 1
        return OperatorStep(action, idle=self._pressed - 1 in self._rests)


def test_another_operator_records_and_its_log_becomes_a_demonstration(recording: OperatorLog, tmp_path: Path):
    rests = tuple(np.flatnonzero(recording.idle).tolist())
    log = record_demonstration(
        AssemblyEnv("one_leg"),
        Keyboard(recording.steps["action"], rests),
        recording.seed,
        name="Ada",
        recorded_at="2026-11-26T14:03:00+01:00",
    )
    assert log.success
    np.testing.assert_array_equal(log.steps["sim_state"], recording.steps["sim_state"])
    write_log(tmp_path / "ada.npz", log)
    (demonstration,) = ingest([tmp_path / "ada.npz"], IngestionConfig(task="one_leg"))
    assert isinstance(demonstration, Demonstration)
    record = demonstration.episode.record
    told = (record.device, record.operator, record.recorded_at, record.log)
    assert told == ("keyboard", "Ada", "2026-11-26T14:03:00+01:00", "ada.npz")


def test_operators_of_several_recordings_are_made_one_by_one(recording: OperatorLog):
    made: list[int] = []

    def operator_of(task: object, seed: int) -> Keyboard:
        made.append(seed)
        return Keyboard(recording.steps["action"][:1])

    first, second = recordings("one_leg", "low", [4, 5], operator_of)
    assert made == [4, 5]
    assert (first.seed, second.seed, first.device, first.success) == (4, 5, "keyboard", False)


def test_an_action_that_is_none_is_refused(recording: OperatorLog):
    with pytest.raises(InvalidAction):
        record_demonstration(AssemblyEnv("one_leg"), Keyboard(np.full((1, 10), np.nan)), recording.seed)


def test_who_recorded_when_survives_the_disk_and_older_logs_say_neither(
    make_log: Callable[..., OperatorLog], tmp_path: Path
):
    write_log(tmp_path / "log.npz", make_log(operator="Ada", recorded_at="2026-11-26"))
    write_log(tmp_path / "older.npz", make_log())
    log, older = read_log(tmp_path / "log.npz"), read_log(tmp_path / "older.npz")
    assert (log.operator, log.recorded_at) == ("Ada", "2026-11-26")
    assert (older.operator, older.recorded_at) == (None, None)
