"""What is known of the logs in a folder, whichever session wrote them."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from juicer.demonstration.log import OperatorLog, write_log
from juicer.teleoperation.logs import Logs
from juicer.teleoperation.verification import CHECKING, VERDICTS, Verdict, Verification, Verifier


def by_name(path: Path, task: str) -> Verification:
    return Verification(Verdict.REJECTED if path.name.startswith("bad") else Verdict.VERIFIED, f"Judged: {path.name}")


def noting(path: Path, task: str) -> Verification:
    with (path.parent / "order").open("a") as file:
        file.write(path.name)
    return Verification(Verdict.VERIFIED, task)


def never(path: Path, task: str) -> Verification:
    time.sleep(600)
    raise AssertionError


@pytest.fixture
def folder(tmp_path: Path, one_leg_log: OperatorLog) -> Path:
    for name in ("good", "bad"):
        write_log(tmp_path / f"{name}.npz", one_leg_log)
    return tmp_path


def checked(folder: Path) -> Logs:
    """Logs of a session in which every check came to an end."""
    verifier = Verifier(by_name)
    logs = Logs(folder, "one_leg", verifier)
    until(lambda: logs.checking == 0)
    verifier.close()
    return logs


def until(test: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not test():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_check_that_was_interrupted_is_made_by_the_next_session_and_nothing_counts_before(folder):
    verifier = Verifier(never)
    logs = Logs(folder, "one_leg", verifier)
    assert (logs.demonstrations, logs.checking) == (0, 2)
    verifier.close()
    logs = checked(folder)
    assert (logs.demonstrations, logs.checking) == (1, 0)


def test_what_a_check_came_to_holds_for_later_sessions(folder):
    checked(folder)
    verifier = Verifier(never)
    logs = Logs(folder, "one_leg", verifier)
    assert verifier.pid is None
    assert (logs.demonstrations, logs.corrections, logs.checking) == (1, 0, 0)
    told = {kept.name: kept.verification for kept in logs.kept}
    assert told["bad.npz"] == Verification(Verdict.REJECTED, "Judged: bad.npz")
    verifier.close()


@pytest.mark.parametrize("damage", ["another log", "no note"])
def test_another_log_of_the_same_name_and_one_whose_note_is_damaged_are_checked_anew(folder, damage):
    checked(folder)
    if damage == "another log":
        (folder / "bad.npz").write_bytes(b"restored from elsewhere")
    else:
        (folder / VERDICTS / "bad.npz.json").write_text("{")
    verifier = Verifier(never)
    assert Logs(folder, "one_leg", verifier).checking == 1
    verifier.close()


def test_a_second_session_does_not_ask_again_for_a_check_under_way(folder):
    verifier = Verifier(never)
    for _ in range(2):
        assert Logs(folder, "one_leg", verifier).checking == 2
    assert verifier._asked.qsize() <= 2
    verifier.close()


def test_of_several_logs_that_wait_the_last_one_is_checked_first(tmp_path):
    verifier = Verifier(noting)
    for name in "abc":  # the first one is taken at once
        verifier.submit(tmp_path / name, "one_leg")
    until(lambda: verifier.known(tmp_path / "b") != CHECKING)
    verifier.close()
    assert (tmp_path / "order").read_text() == "acb"
