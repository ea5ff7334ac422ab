"""Stages as Prefect tasks: seen, ordered, retried only where that helps."""

from __future__ import annotations

import asyncio
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import replace

import pytest
from prefect import flow, get_client
from prefect.client.schemas.filters import FlowRunFilter
from prefect.context import FlowRunContext
from prefect.task_runners import ThreadPoolTaskRunner
from prefect.testing.utilities import prefect_test_harness

from juicer.errors import ArtifactError, NothingLeft, StoreUnreachable
from stages.runtime import prefect_task
from stages.runtime.context import StageInterrupted
from stages.runtime.execution import is_reused, perform_here
from stages.runtime.messages import portable
from stages.runtime.prefect_task import PrefectPerformer, _may_pass


@pytest.fixture(scope="module", autouse=True)
def prefect_server():
    with prefect_test_harness(server_startup_timeout=120):
        yield


@pytest.fixture
def tasks(session):
    return replace(session, performer=PrefectPerformer(), label="bc seed 0")


def in_flow(function, workers=2):
    """Run a function within a flow run; gives what it returns and the id of the flow run."""

    @flow(task_runner=ThreadPoolTaskRunner(max_workers=workers), persist_result=False)
    def wrapper():
        return function(), FlowRunContext.get().flow_run.id

    return wrapper()


def task_runs(flow_run_id, expected):
    async def read():
        async with get_client() as client:
            for _ in range(50):
                runs = await client.read_task_runs(flow_run_filter=FlowRunFilter(id={"any_": [flow_run_id]}))
                if len(runs) >= expected and all(run.state and run.state.is_final() for run in runs):
                    return runs
                await asyncio.sleep(0.2)
            raise AssertionError("the task runs did not arrive")

    return {run.name: run for run in asyncio.run(read())}


def test_hit_is_shown_as_reused_and_inputs_as_edges(toys, tasks):
    config = toys.ToyConfig(words=5)
    first = toys.write(replace(tasks, performer=perform_here), config=config)

    def body():
        episodes = toys.write(tasks, config=config)
        return episodes, toys.count(tasks, episodes=(episodes,), config=config)

    (episodes, _), run_id = in_flow(body)
    runs = task_runs(run_id, 2)
    assert episodes == first
    assert runs["write bc seed 0 (reused)"].state.name == "Reused"
    assert runs["count bc seed 0"].state.name == "Completed"
    (edge,) = runs["count bc seed 0"].task_inputs["wait_for"]
    assert edge.id == runs["write bc seed 0 (reused)"].id


def test_error_of_a_body_passes_unchanged_and_is_not_retried(toys, tasks):
    def body():
        with pytest.raises(NothingLeft, match="nothing to work on"):
            toys.fail(tasks, config=toys.ToyConfig())

    _, run_id = in_flow(body)
    (run,) = task_runs(run_id, 1).values()
    assert (run.state.name, run.run_count) == ("Failed", 1)


def test_only_what_may_pass_by_itself_is_retried():
    class State:
        def __init__(self, error):
            self.error = error

        def result(self, raise_on_failure):
            return self.error

    wrapped = ArtifactError("the store cannot be read")
    wrapped.__cause__ = ConnectionResetError()
    assert _may_pass(None, None, State(wrapped))
    assert _may_pass(None, None, State(portable(StoreUnreachable("the store cannot be read"), "bc")))
    assert not _may_pass(None, None, State(ArtifactError("no such artifact")))


def test_calls_for_one_id_run_once_and_occupy_one_worker(toys, tasks, diary):
    shown = replace(tasks, display=diary)

    def body():
        with ThreadPoolExecutor() as pool:
            config = toys.ToyConfig(words=7)
            futures = [pool.submit(copy_context().run, lambda: toys.write(shown, config=config)) for _ in range(3)]
            return [future.result() for future in futures]

    refs, _ = in_flow(body, workers=1)
    assert len(set(refs)) == 1
    assert sorted(state for _, state in diary.states) == ["done", "reused", "reused"]


def test_interrupt_cancels_the_running_task(toys, tasks):
    isolated = replace(tasks, isolate=True)
    threading.Timer(1.5, isolated.stop.set).start()
    seen = []

    def body():
        with pytest.raises(StageInterrupted):
            toys.dawdle(isolated, config=toys.ToyConfig())
        with pytest.raises(StageInterrupted):
            toys.write(isolated, config=toys.ToyConfig(words=99))
        seen.append(True)

    _, run_id = in_flow(body)
    assert seen
    assert {name: run.state.name for name, run in task_runs(run_id, 1).items()} == {"dawdle bc seed 0": "Cancelled"}


def test_a_task_that_waits_for_a_worker_does_not_begin_after_an_interrupt(toys, tasks, diary, monkeypatch):
    isolated = replace(tasks, isolate=True, display=diary)
    is_called = threading.Event()

    def looked_up(call, session):
        if call.stage.name == "write":
            is_called.set()
        return is_reused(call, session)

    monkeypatch.setattr(prefect_task, "is_reused", looked_up)

    def end(stage, **config):
        with pytest.raises(StageInterrupted):
            stage(isolated, config=toys.ToyConfig(**config))

    def body():
        with ThreadPoolExecutor() as pool:
            running = pool.submit(copy_context().run, end, toys.dawdle)
            while not (diary.progress or running.done()):
                time.sleep(0.1)
            waiting = pool.submit(copy_context().run, end, toys.write, words=98)
            assert is_called.wait(60)
            isolated.stop.set()
            running.result()
            waiting.result()

    in_flow(body, workers=1)
    assert diary.states == [("dawdle", "stopped")]
