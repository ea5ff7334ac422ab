import errno
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from juicer.demonstration.log import OperatorLog, write_log
from juicer.errors import RejectedLog
from juicer.teleoperation.verification import ATTEMPTS, NICENESS, Verdict, Verification, Verifier, replay, verify


@pytest.fixture
def verifier() -> Iterator[Verifier]:
    verifier = Verifier()
    yield verifier
    verifier.close()


def wait_for(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def verdict_of(verifier: Verifier, path: Path) -> Verification:
    def found() -> Verification | None:
        known = verifier.known(path)
        return known if known and known.verdict is not Verdict.CHECKING else None

    wait_for(found)
    known = found()
    assert known
    return known


def test_a_log_that_replays_to_a_success_is_verified_by_a_process_of_low_priority(
    verifier: Verifier, one_leg_log: OperatorLog, tmp_path: Path
) -> None:
    write_log(tmp_path / "a.npz", one_leg_log)
    verifier.submit(tmp_path / "a.npz", "one_leg")
    wait_for(lambda: verifier.pid)
    wait_for(lambda: verifier.pid is None or os.getpriority(os.PRIO_PROCESS, verifier.pid) == NICENESS)
    verification = verdict_of(verifier, tmp_path / "a.npz")
    assert verification == Verification(
        Verdict.VERIFIED, f"Saved: its {len(one_leg_log):,} steps replay bit for bit to a success"
    )


@pytest.mark.parametrize("lacking", ["Pipe", "Process"])
def test_a_system_that_has_no_process_to_give_now_does_not_end_all_checking(
    verifier: Verifier, one_leg_log: OperatorLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lacking: str
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    write_log(tmp_path / "a.npz", one_leg_log)
    with monkeypatch.context() as patched:
        patched.setattr(type(multiprocessing.get_context("spawn")), lacking, refuse)
        verifier.submit(tmp_path / "a.npz", "one_leg")
        assert verdict_of(verifier, tmp_path / "a.npz").verdict is Verdict.UNCHECKED
    write_log(tmp_path / "b.npz", one_leg_log)
    verifier.submit(tmp_path / "b.npz", "one_leg")
    assert verdict_of(verifier, tmp_path / "b.npz").verdict is Verdict.VERIFIED


def test_a_single_bit_that_differs_is_found(one_leg_log: OperatorLog) -> None:
    assert replay(one_leg_log) == len(one_leg_log)
    states = np.array(one_leg_log.steps["sim_state"])
    states[200, 30] = np.nextafter(states[200, 30], np.inf)
    with pytest.raises(RejectedLog, match="a replay of its actions leads elsewhere after step 199"):
        replay(replace(one_leg_log, steps={**one_leg_log.steps, "sim_state": states}))


def test_what_is_no_log_is_rejected_in_a_sentence(tmp_path: Path, one_leg_log: OperatorLog) -> None:
    path = tmp_path / "a.npz"
    path.write_bytes(b"nonsense")
    assert verify(path, "one_leg").verdict is Verdict.REJECTED
    write_log(path, one_leg_log)
    assert verify(path, "lamp") == Verification(
        Verdict.REJECTED, "It cannot be used: it shows task 'one_leg', but 'lamp' is being ingested"
    )


def test_a_killed_process_is_replaced_and_the_log_verified(
    verifier: Verifier, one_leg_log: OperatorLog, tmp_path: Path
) -> None:
    write_log(tmp_path / "a.npz", one_leg_log)
    verifier.submit(tmp_path / "a.npz", "one_leg")
    wait_for(lambda: verifier.pid)
    assert verifier.pid
    os.kill(verifier.pid, signal.SIGKILL)
    assert verdict_of(verifier, tmp_path / "a.npz").verdict is Verdict.VERIFIED


def dies(path: Path, task: str) -> Verification:
    with path.open("a") as file:
        file.write("x")
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def dies_over_b(path: Path, task: str) -> Verification:
    return dies(path, task) if path.name == "b" else Verification(Verdict.VERIFIED, task)


def test_a_log_that_kills_every_process_is_left_unchecked_and_the_next_is_verified(tmp_path: Path) -> None:
    verifier = Verifier(dies_over_b)
    verifier.submit(tmp_path / "b", "one_leg")
    verifier.submit(tmp_path / "c", "one_leg")
    assert verdict_of(verifier, tmp_path / "b").verdict is Verdict.UNCHECKED
    assert (tmp_path / "b").read_text() == "x" * ATTEMPTS
    assert verdict_of(verifier, tmp_path / "c").verdict is Verdict.VERIFIED
    verifier.close()


def sleeps(path: Path, task: str) -> Verification:
    time.sleep(600)
    raise AssertionError


def test_closing_ends_the_process_at_once(tmp_path: Path) -> None:
    verifier = Verifier(sleeps)
    verifier.submit(tmp_path / "a", "one_leg")
    wait_for(lambda: verifier.pid)
    pid = verifier.pid
    assert pid
    verifier.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
