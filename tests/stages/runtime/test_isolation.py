"""A stage body in a process of its own: same results, and no way to take the rest down with it."""

from __future__ import annotations

import os
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from juicer.errors import ForeignCode, StageDied
from stages.record import RecordConfig, record
from stages.runtime.context import StageInterrupted
from stages.runtime.execution import execute
from stages.runtime.machine import Machine


@pytest.fixture
def isolated(session):
    return replace(session, isolate=True)


def test_isolated_body_gives_the_same_artifact_from_another_process(toys, isolated, session, store, diary):
    ref = toys.write(replace(isolated, display=diary, record=diary), config=toys.ToyConfig(words=2))
    assert store.manifest(ref).summary["process"] != os.getpid()
    assert diary.progress == [(2, 2, {"mood": "good"})]
    assert diary.curves == [(1, {"length": 10.0})]
    assert toys.write(session, config=toys.ToyConfig(words=2)) == ref


def test_isolated_body_may_have_huge_pages(toys, isolated, store):
    ref = toys.write(isolated, config=toys.ToyConfig(words=3))
    # Whoever starts the tests may have set others, which stand.
    assert store.manifest(ref).summary["tunables"] == os.environ["GLIBC_TUNABLES"]


@pytest.mark.parametrize("isolate", [True, False], ids=["isolated", "here"])
def test_cpu_time_is_that_of_the_body_and_of_the_processes_it_starts(toys, session, store, isolate):
    ref = toys.toil(replace(session, isolate=isolate), config=toys.ToyConfig())
    assert store.manifest(ref).cpu_seconds >= 0.99


def test_cpu_time_of_work_that_is_shared_is_that_of_all_who_share_it(toys, isolated, store):
    ref = toys.toil_together(replace(isolated, machine=Machine(processes=2)), config=toys.ToyConfig())
    assert len(store.manifest(ref).files) == 2
    assert store.manifest(ref).cpu_seconds >= 4


def test_error_that_cannot_be_pickled_still_tells_what_happened(toys, isolated):
    with pytest.raises(RuntimeError, match=r"(?s)ValueError\('odd'\).*In the process of stage 'crash'"):
        toys.crash(isolated, config=toys.ToyConfig())


def test_process_that_is_killed_is_named(toys, isolated, store):
    with pytest.raises(StageDied, match=r"stage 'die' was ended by SIGKILL; the machine may have run out of memory"):
        toys.die(isolated, config=toys.ToyConfig())
    assert store.refs() == []


def test_another_task_than_the_recipe_names_makes_nothing(isolated, store):
    call = record.prepare(isolated, config=RecordConfig(task="lamp", randomness="low", demonstrations=1))
    call.recipe.tasks["lamp"]["max_steps"] = 7
    with pytest.raises(ForeignCode, match=r"stage 'record' would run other code .*\(task lamp in"):
        execute(call, isolated)
    assert store.refs() == []


def test_other_code_than_the_recipe_names_makes_nothing(toys, isolated, store):
    call = toys.write.prepare(isolated, config=toys.ToyConfig())
    call.recipe.modules["toys.simple"] = "of another checkout"
    with pytest.raises(ForeignCode, match=r"stage 'write' would run other code .*\(toys.simple in '.*toys' differs\)"):
        execute(call, isolated)
    assert store.refs() == []


def test_interrupt_ends_the_process(toys, isolated, store):
    def stop_once_it_lives():
        while not any(file.read_text() for file in Path(store.url).rglob("pid")):
            time.sleep(0.05)
        isolated.stop.set()

    threading.Thread(target=stop_once_it_lives, daemon=True).start()
    with pytest.raises(StageInterrupted):
        toys.dawdle(isolated, config=toys.ToyConfig())
    (pid_file,) = Path(store.url).rglob("pid")
    assert not _lives(int(pid_file.read_text()))


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{pid}/status").read_text().find("State:\tZ") == -1
