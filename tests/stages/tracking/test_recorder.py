"""A run tells MLflow of itself in the background; a server that is away costs nothing, and is caught up with later."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from stages.tracking import publish as publishing
from stages.tracking.destination import Destination
from stages.tracking.model import Model
from stages.tracking.recorder import Recorder

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")
ROOT = Path(__file__).parents[3]
PATIENCE = 100.0


def record(destination, store, *models, points=(), status="FINISHED"):
    """What a run tells; gives what it warns of, and whether MLflow shows everything."""
    warnings = []
    recorder = Recorder(destination, store, warnings.append)
    recorder.start()
    for model, step in points:
        recorder.log(model, {"train/loss": 1.0 / step}, step)
    for model in models:
        recorder.note(model)
    return recorder.finish(PATIENCE, status), warnings


def runs_of(destination):
    client = destination.connect()
    experiment = client.get_experiment_by_name("study")
    return client, {run.info.run_name: run for run in client.search_runs([experiment.experiment_id])}


def test_curves_are_shown_while_a_model_is_made_and_once_in_the_end(destination, store, study):
    model = study.model()
    begun = model.model_copy(update={"evaluation": ""})
    assert record(destination, store, points=[(begun, 10), (begun, 20)], status="FAILED") == (True, [])
    client, runs = runs_of(destination)
    assert runs["BC, seed 0"].info.status == "FAILED"
    assert [point.step for point in client.get_metric_history(runs["BC, seed 0"].info.run_id, "train/loss")] == [10, 20]
    assert record(destination, store, model, points=[(begun, 30)]) == (True, [])
    _, runs = runs_of(destination)
    assert set(runs) == {"BC", "BC, seed 0"}
    points = client.get_metric_history(runs["BC, seed 0"].info.run_id, "train/loss")
    assert sorted(point.step for point in points) == list(range(10, 500, 10))
    assert runs["BC, seed 0"].info.status == "FINISHED"
    assert not list(destination.folder.glob("*.live"))


def test_a_model_that_is_trained_anew_is_shown_in_a_run_of_its_own_from_the_first_point_on(destination, store, study):
    model, other = study.model(), study.model(seed=1)
    record(destination, store, model)
    begun = model.model_copy(update={"evaluation": ""})
    assert record(destination, store, other, points=[(begun, 10)], status="FAILED") == (True, [])
    client, runs = runs_of(destination)
    assert set(runs) == {"BC", "BC, seed 0 (earlier)", "BC, seed 0", "BC, seed 1"}
    steps = {
        name: sorted(point.step for point in client.get_metric_history(run.info.run_id, "train/loss"))
        for name, run in runs.items()
    }
    assert (len(steps["BC, seed 0 (earlier)"]), steps["BC, seed 0"]) == (49, [10])
    record(destination, store, model.model_copy(update={"evaluation": other.evaluation}), points=[(begun, 20)])
    _, again = runs_of(destination)
    assert {run.info.run_name: run.info.run_id for run in again.values()} == {
        run.info.run_name: run.info.run_id for run in runs.values()
    }
    assert again["BC, seed 0"].info.status == "FINISHED"
    assert again["BC, seed 0"].data.tags["juicer.checkpoint"] == again["BC, seed 1"].data.tags["juicer.checkpoint"]


def test_a_model_that_is_trained_once_more_to_the_same_end_is_finished(destination, store, study):
    model = study.model()
    begun = model.model_copy(update={"evaluation": ""})
    record(destination, store, model)
    for _ in range(2):
        assert record(destination, store, model, points=[(begun, 10)]) == (True, [])
        assert record(destination, store, study.model(seed=1)) == (True, [])
        _, runs = runs_of(destination)
        assert {run.info.status for run in runs.values()} == {"FINISHED"}
        assert "success_rate" in runs["BC, seed 0"].data.metrics


def test_of_studies_that_are_shown_only_those_with_something_new_are_looked_at_again(
    destination, store, study, monkeypatch
):
    looked_at = []
    publish = publishing.publish
    monkeypatch.setattr(
        publishing, "publish", lambda *about: looked_at.append({model.study for model in about[2]}) or publish(*about)
    )
    record(destination, store, study.model())
    study.name = "other"
    other = study.model(seed=1)
    recorder = Recorder(destination, store, print)
    client = destination.connect()
    looked_at.clear()
    recorder._publish(client)
    recorder._publish(client)
    recorder.note(other)
    recorder._publish(client)
    assert looked_at == [{"study"}, set(), {"other"}]


def test_a_server_that_is_away_costs_a_sentence_and_a_later_run_catches_up(destination, store, study, tmp_path, data):
    model = study.model()
    (tmp_path / "file").touch()
    for uri, shown in (
        ("http://ann:secret@127.0.0.1:9", "http://127.0.0.1:9"),
        (f"sqlite:///{tmp_path / 'file' / 'mlflow.db'}", f"sqlite:///{tmp_path / 'file' / 'mlflow.db'}"),
    ):
        away = Destination(uri, destination.folder)
        is_shown, (warning,) = record(away, store, model, points=[(model, 10)])
        assert not is_shown
        assert warning.startswith(f"MLflow at '{shown}' cannot be used (")
        assert "secret" not in warning
        assert warning.count("cannot be used") == 1
        assert warning.endswith("the run goes on, and a later one records what this one makes")
    assert record(destination, store, study.model(seed=1)) == (True, [])
    assert set(runs_of(destination)[1]) == {"BC", "BC, seed 0", "BC, seed 1"}


def test_another_destination_is_not_told(destination, store, study, data, empty_database, tmp_path):
    other = tmp_path / "other.db"
    other.write_bytes(empty_database.read_bytes())
    record(Destination.of("http://127.0.0.1:9", data / "tracking"), store, study.model(seed=3))
    elsewhere = Destination.of(f"sqlite:///{other}", data / "tracking")
    record(elsewhere, store, study.model(seed=4))
    record(destination, store, study.model())
    assert set(runs_of(destination)[1]) == {"BC", "BC, seed 0"}
    # Its files go where the database says, not into the working directory.
    place = runs_of(elsewhere)[1]["BC, seed 4"].info.artifact_uri
    assert place.startswith(f"{empty_database.with_name('mlflow-files').as_uri()}/study/")


def test_a_deleted_run_or_experiment_keeps_nothing_else_from_being_shown(destination, store, study):
    deleted, kept = study.model(seed=0), study.model(seed=1)
    record(destination, store, deleted)
    client, runs = runs_of(destination)
    client.delete_run(runs["BC, seed 0"].info.run_id)
    assert record(destination, store, kept, points=[(deleted, 10), (kept, 10)]) == (True, [])
    assert set(runs_of(destination)[1]) == {"BC", "BC, seed 1"}
    client.delete_experiment(client.get_experiment_by_name("study").experiment_id)
    study.name = "other"
    is_shown, (warning,) = record(destination, store, study.model(), points=[(deleted, 20)])
    assert is_shown
    assert "the experiment 'study' was deleted in MLflow" in warning
    assert client.get_experiment_by_name("other") is not None


KILLED = """
import sys, time
from pathlib import Path
from juicer.artifacts.store import ArtifactStore
from stages.tracking.destination import Destination
from stages.tracking.model import Model
from stages.tracking.recorder import Recorder
data = Path(sys.argv[1])
place = Destination(f"sqlite:///{data / 'mlflow.db'}", data / "tracking" / "here", data / "mlflow-files")
recorder = Recorder(place, ArtifactStore(data), print)
recorder.start()
recorder.log(Model.model_validate_json(sys.argv[2]), {"train/loss": 1.0}, 10)
time.sleep(600)
"""


def test_a_killed_run_is_marked_by_the_next_one(destination, store, study, data):
    begun = study.model().model_copy(update={"evaluation": ""})
    command = [sys.executable, "-c", KILLED, str(data), begun.model_dump_json()]
    process = subprocess.Popen(command, cwd=ROOT)
    while not list(destination.folder.glob("*.live")):
        assert process.poll() is None
        time.sleep(0.1)
    record(destination, store)
    assert runs_of(destination)[1]["BC, seed 0"].info.status == "RUNNING"
    process.kill()
    process.wait()
    record(destination, store)
    assert runs_of(destination)[1]["BC, seed 0"].info.status == "KILLED"
    record(destination, store, study.model())
    assert runs_of(destination)[1]["BC, seed 0"].info.status == "FINISHED"


def test_a_note_that_cannot_be_written_stops_nothing(store, study, tmp_path):
    (tmp_path / "file").touch()
    uri = f"sqlite:///{tmp_path / 'file' / 'mlflow.db'}"
    is_shown, warnings = record(Destination(uri, tmp_path / "file" / "tracking"), store, study.model())
    assert not is_shown
    assert any("cannot be noted for MLflow" in warning for warning in warnings)


def test_a_kill_while_the_database_is_made_leaves_one_that_can_be_used(tmp_path):
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    code = "import sys; from pathlib import Path; from stages.tracking.destination import *; "
    code += "Destination(sys.argv[2], Path(sys.argv[1])).initialise()"
    command = [sys.executable, "-c", code, str(tmp_path / "tracking"), uri]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, cwd=ROOT)
    while process.poll() is None and not (tmp_path / "mlflow.db.draft").exists():
        time.sleep(0.01)
    time.sleep(0.2)
    process.kill()
    assert process.wait() == -9
    client = Destination(uri, tmp_path / "tracking").initialise()
    assert [path.name for path in tmp_path.glob("mlflow.db*")] == ["mlflow.db"]
    assert len(client.search_registered_models()) == 0


def test_what_identifies_a_model_is_checked():
    with pytest.raises(ValueError, match="identity"):
        Model(study="a", identity="../../etc", condition="bc", title="BC", seed=0, task="one_leg", params={})
