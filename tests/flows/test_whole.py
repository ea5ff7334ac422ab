"""The real thing in small: every stage of a study from the command line, in Prefect, with MLflow."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from distributed import LocalCluster

from flows.running.settings import read_settings
from flows.servers.environment import DATABASE_VARIABLE, quiet_environment
from flows.servers.temporary import TemporaryServer
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore

SMOKE = Path(__file__).parents[2] / "configs" / "smoke.yaml"


# A policy that learned for a second succeeds at nothing, and costs nothing.
RUN = [
    "run",
    str(SMOKE),
    "--set=record.demonstrations=2",
    "--set=augment.num_snippets=4",
    "--set=policies.diffusion.training={steps: 60, warmup_steps: 10, validation_fraction: 0.2}",
    "--set=policies.diffusion.training.windows={back_padding: 15}",
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
    assert [row["title"] for row in first["table"]] == ["BC", "TA+CI"]
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


def test_damaged_checkpoint_is_repaired(data, first, server):
    checkpoint = first["models"][0]["checkpoint"]
    weights = data / checkpoint / "weights.safetensors"
    whole = weights.read_bytes()
    weights.write_bytes(whole[:-1] + b"x")
    evaluate = ("evaluate", checkpoint, "-n", "1", "--seed-start", "9")
    _, err = finish(juicer(data, *evaluate, server=server), status=1)
    assert f"recompute it with `juicer repair {checkpoint.partition('/')[2]}`" in err
    finish(juicer(data, "repair", checkpoint, server=server))
    assert weights.read_bytes() == whole
    finish(juicer(data, *evaluate, "--inference-steps", "1", server=server))


def test_any_checkpoint_is_analysed_and_its_figure_written(data, first, server, tmp_path):
    checkpoint, figure = first["models"][0]["checkpoint"], tmp_path / "samples.png"
    settings = ("--set", "analyses.sampling.samples=20", "--set", "analyses.sampling.inference_steps=[1, 2]")
    analyse = ("analyse", "sampling", checkpoint, *settings, "--figure")
    out, _ = finish(juicer(data, *analyse, str(figure), server=server))
    assert "20 samples of an action at step" in out
    assert figure.read_bytes().startswith(b"\x89PNG")
    _, err = finish(juicer(data, *analyse, str(tmp_path)), status=1)
    assert "must end in .png" in err


def test_a_checkpoint_is_measured_under_a_shift_from_the_command_line(data, first, server):
    checkpoint = first["models"][0]["checkpoint"]
    arguments = ("evaluate", checkpoint, "-n", "1", "--seed-start", "9", "--shift")
    out, _ = finish(juicer(data, *arguments, "friction", server=server))
    assert "success 0% of 1 episodes, with other friction (" in out
    out, _ = finish(juicer(data, *arguments, "{kind: friction, factor: 0.7}", "--json", server=server))
    ref = json.loads(out)["evaluation"]
    assert ArtifactStore(data).manifest(ArtifactRef.parse(ref)).recipe.config["shift"]["factor"] == 0.7
    _, err = finish(juicer(data, *arguments, "pusch"), status=1)
    assert "kind must be one of outside, push, friction, light, camera" in err
    _, err = finish(juicer(data, *arguments, "light", server=server), status=1)
    assert "the policy sees no images, so it cannot notice a shift of kind 'light'" in err


def worker_at_work(data, process):
    """The process, other than the run's own, that holds the lock of a training."""
    for _ in range(1200):
        if process.poll() is not None:
            pytest.fail(process.stderr.read())
        for lock in Path("/proc").glob("[0-9]*/fd/*"):
            pid = int(lock.parts[2])
            with suppress(OSError):
                if pid != process.pid and lock.readlink().match(f"{data}/.work/locks/*.lock"):
                    return pid
        time.sleep(0.1)
    pytest.fail("no stage began")


TRAINED = [*RUN, "--set=conditions=[bc]", "--set=policies.diffusion.training.steps=600", "--json"]


@pytest.fixture(scope="module")
def plain(server, tmp_path_factory):
    """Artifacts of a run on threads."""
    data = tmp_path_factory.mktemp("plain") / "data"
    return data, json.loads(finish(juicer(data, *TRAINED, server=server))[0])


@pytest.mark.slow
@pytest.mark.parametrize("runner", ["dask", "ray"])
def test_a_killed_worker_leads_to_the_same_artifacts(plain, server, tmp_path, runner):
    process = juicer(tmp_path / "data", *TRAINED, server={**server, "JUICER_RUNNER": runner})
    while "train" not in (line := process.stderr.readline()) or "begins" not in line:
        assert line, "the run ended before it trained"
    os.kill(worker_at_work(tmp_path / "data", process), signal.SIGKILL)
    found = json.loads(finish(process)[0])
    assert found == plain[1]
    for name in ("checkpoint", "evaluation"):
        ref = ArtifactRef.parse(found["models"][0][name])
        there, here = (ArtifactStore(data).manifest(ref) for data in (tmp_path / "data", plain[0]))
        assert there.content == here.content


@pytest.fixture(scope="module")
def lab(data, tmp_path_factory):
    """Address of a Dask scheduler with a worker that has a data folder of its own."""
    folder = tmp_path_factory.mktemp("lab")
    environment = {**os.environ, "JUICER_DATA": str(folder / "data"), "PYTHONPATH": str(SMOKE.parents[1])}
    with LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        command = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads=1", "--no-dashboard"]
        worker = subprocess.Popen(command, env=environment, cwd=folder, start_new_session=True)
        yield address
        os.killpg(worker.pid, signal.SIGTERM)
        worker.wait(60)


def test_a_stage_runs_on_the_cluster_of_a_lab(data, server, lab):
    chosen = ("-c", str(SMOKE), "--set=record.demonstrations=1", "--set=record.first=50", "--condition", "bc")
    out, err = finish(juicer(data, "stage", "record", *chosen, server={**server, "JUICER_RUNNER": lab}))
    assert "✓ record" in err
    assert ArtifactStore(data).manifest(ArtifactRef.parse(out.split()[0])).summary["successes"] == 1


def test_a_cluster_that_does_not_answer_is_named(data, server):
    address = "tcp://127.0.0.1:9"
    _, err = finish(juicer(data, *RUN, server={**server, "JUICER_RUNNER": address}), status=1)
    assert f"the cluster at '{address}' does not answer" in err


def test_a_cluster_needs_a_prefect_server_that_it_reaches(data):
    _, err = finish(juicer(data, *RUN, server={"JUICER_RUNNER": "ray://127.0.0.1:9"}), status=1)
    assert "a cluster needs a Prefect server that its machines reach" in err
