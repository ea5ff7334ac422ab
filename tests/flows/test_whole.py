"""The real thing in small: every stage of a study from the command line, in Prefect, with MLflow."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_URL, temporary_settings

from flows.remote.dispatch import DEPLOYMENT, send
from flows.remote.worker import make
from flows.running.settings import read_settings
from flows.servers.environment import API_VARIABLE, DATABASE_VARIABLE, PASSWORD_VARIABLE, quiet_environment
from flows.servers.temporary import TemporaryServer
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError, ServiceUnavailable
from stages.record import RecordConfig, record
from stages.runtime.execution import execute, perform_here
from stages.runtime.session import Session
from stages.runtime.stage import StageCall

SMOKE = Path(__file__).parents[2] / "configs" / "smoke.yaml"


# A policy that learned for a second succeeds at nothing, and costs nothing.
RUN = [
    "run",
    str(SMOKE),
    "--set=record.demonstrations=2",
    "--set=augment.num_snippets=4",
    "--set=train.diffusion.training={steps: 60, warmup_steps: 10, validation_fraction: 0.2}",
    "--set=train.diffusion.training.windows={back_padding: 15}",
    "--set=collect={successes: 2, max_episodes: 4, max_steps: 40}",
    "--set=evaluate={episodes: 2, max_steps: 40}",
]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return tmp_path_factory.mktemp("whole") / "data"


@pytest.fixture(scope="module")
def server(data):
    """A Prefect server that most runs use, as each of their own would cost seconds to start."""
    data.mkdir(parents=True)
    variables = {**quiet_environment(read_settings()), DATABASE_VARIABLE: f"sqlite+aiosqlite:///{data / 'prefect.db'}"}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in variables.items():
            patch.setenv(name, value)
        server = TemporaryServer()
    server.wait(120)
    yield server.variables
    server.stop()


def juicer(data, *arguments, server=None):
    environment = {**os.environ, "JUICER_DATA": str(data), **(server or {})}
    command = [sys.executable, "-m", "juicer", *arguments]
    return subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def prefect_settings(server):
    return {PREFECT_API_URL: server[API_VARIABLE], PREFECT_API_AUTH_STRING: server[PASSWORD_VARIABLE]}


def finish(process, status=0):
    out, err = process.communicate(timeout=280)
    assert process.returncode == status, err
    return out, err


def wait_for_work(process):
    for line in process.stderr:
        if "begins" in line:
            break
    time.sleep(3)


@pytest.fixture(scope="module")
def first(data, server):
    """The first run to its end, after one that was killed and one that was interrupted."""
    process = juicer(data, *RUN, server=server)
    wait_for_work(process)
    process.kill()
    process.communicate(timeout=60)

    process = juicer(data, *RUN)
    wait_for_work(process)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert err.strip().splitlines()[-1].startswith("juicer: interrupted; nothing is half-written")

    return json.loads(finish(juicer(data, *RUN, "--json", server=server))[0])


def test_study_ends_with_a_table_and_the_finding_that_nothing_succeeded(first):
    assert [row["condition"] for row in first["table"]] == ["BC", "TA+CI"]
    (finding,) = first["findings"]
    assert finding.startswith("TA+CI, seed 0: no successful rollout to retrain on")
    assert first["report"]


def test_run_that_ended_with_a_finding_is_not_begun_again(data, first):
    out, err = finish(juicer(data, *RUN, "--json"))
    assert json.loads(out) == first
    assert "starting a Prefect server" not in err
    assert "begins" not in err


def test_nothing_half_written_is_left(data, first):
    drafts = data / ".work" / "drafts"
    assert not list(drafts.iterdir())
    assert json.loads(finish(juicer(data, "verify", "--json"))[0])["damaged"] == {}


def test_uninterrupted_run_ends_with_the_same_artifacts(first, server, tmp_path):
    run = (*RUN, "--set", "conditions=[bc]")
    again = json.loads(finish(juicer(tmp_path / "data", *run, "--json", server=server))[0])
    (model,) = again["models"]
    assert model == first["models"][0]
    _, err = finish(juicer(tmp_path / "data", *run))
    assert "starting a Prefect server" not in err
    assert "begins" not in err


def test_prefect_kept_the_states_and_mlflow_the_runs(data, first):
    with sqlite3.connect(data / "prefect.db") as database:
        flow_runs = {state for (state,) in database.execute("select state_name from flow_run")}
        states = {state for (state,) in database.execute("select state_name from task_run")}
    assert "Completed" in flow_runs
    assert {"Completed", "Reused"} <= states
    with sqlite3.connect(data / "mlflow.db") as database:
        runs = dict(database.execute("select name, status from runs"))
        models = {name for (name,) in database.execute("select name from registered_models")}
    assert runs == dict.fromkeys(["BC", "TA+CI", "BC, seed 0", "TA+CI, seed 0"], "FINISHED")
    assert models == {"smoke.bc", "smoke.ta_ci"}


def test_single_stage_is_forced_to_run_again_with_the_same_id(data, first, server):
    arguments = ("-c", str(SMOKE), *RUN[2:], "--condition", "bc", "--force")
    out, err = finish(juicer(data, "stage", "evaluate", *arguments, server=server))
    assert out.split() == [first["models"][0]["evaluation"]]
    assert "evaluate  bc seed 0                begins" in err


def test_damaged_checkpoint_is_repaired(data, first):
    checkpoint = first["models"][0]["checkpoint"]
    weights = data / checkpoint / "weights.safetensors"
    whole = weights.read_bytes()
    weights.write_bytes(whole[:-1] + b"x")
    _, err = finish(juicer(data, "evaluate", checkpoint, "-n", "1", "--seed-start", "9"), status=1)
    assert f"recompute it with `juicer repair {checkpoint.partition('/')[2]}`" in err
    finish(juicer(data, "repair", checkpoint))
    assert weights.read_bytes() == whole
    finish(juicer(data, "evaluate", checkpoint, "-n", "1", "--seed-start", "9"))


RECORDING = record.prepare(config=RecordConfig(task="one_leg", randomness="low", demonstrations=1, first=50))


def test_a_stage_does_not_wait_for_ever_for_a_machine_to_serve_it(data, server, monkeypatch):
    monkeypatch.setattr("flows.remote.dispatch.PATIENCE_SECONDS", 0.5)
    with temporary_settings(prefect_settings(server)):
        make.to_deployment(DEPLOYMENT).apply()
        with pytest.raises(ServiceUnavailable, match="no machine offers to run stages; start `juicer serve`"):
            execute(RECORDING, Session(ArtifactStore(data), perform_here, send=send))


@pytest.fixture(scope="module")
def serving(data, server):
    """A machine that runs the stages of others, and a session that sends them."""
    process = juicer(data, "serve", server=server)
    for line in process.stdout:
        if line.startswith("waiting for runs"):
            break
    else:
        pytest.fail(process.stderr.read())
    with temporary_settings(prefect_settings(server)):
        yield Session(ArtifactStore(data), perform_here, send=send, label="bc seed 0")
    os.killpg(process.pid, signal.SIGINT)
    process.communicate(timeout=60)


def test_a_stage_runs_on_the_machine_that_serves_stages(serving):
    finished = execute(RECORDING, serving)
    assert not finished.reused
    assert serving.store.manifest(finished.ref).summary["successes"] == 1


def test_a_machine_with_another_juicer_declines(serving):
    asked = StageCall(record, RECORDING.arguments, replace(RECORDING.recipe, code="of yesterday"))
    with pytest.raises(ArtifactError, match=r"another juicer, or other libraries, than the one that asks: .*code"):
        execute(asked, serving)
