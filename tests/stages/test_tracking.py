"""Records reach MLflow sooner or later, once, and never stand in the way."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
import time

import pytest
from stages.tracking.courier import Courier, Destination, initialise
from stages.tracking.journal import END, MADE, METRICS, RESUMED, RUN, DeliveryState, Journal
from stages.tracking.record import ModelRecord, RunDescription, RunRecord

from juicer.artifacts.ref import ArtifactRef

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")

EPISODES = ArtifactRef("episodes", "0123456789abcdef")
CHECKPOINT = ArtifactRef("checkpoint", "fedcba9876543210")


def description(name="bc seed 0", **identity):
    tags = {"condition": "bc", "seed": "0", "juicer.model": "one_leg.bc", "juicer.alias": "seed-0"}
    return RunDescription("study", name, identity, {"train.training.steps": 10}, tags)


def events(record):
    return [entry.content["event"] for entry in record.journal.entries()]


def test_run_that_is_started_again_repeats_nothing(tmp_path):
    record = RunRecord(tmp_path, description())
    ModelRecord(record).made(EPISODES, "ingest")
    record.close("FINISHED")
    size = record.journal.path.stat().st_size
    again = RunRecord(tmp_path, description())
    ModelRecord(again).made(EPISODES, "ingest")
    again.result({"success_rate": 0.5})
    again.close("FINISHED")
    assert again.journal.path.stat().st_size == size


def test_run_that_goes_on_after_its_end_says_so(tmp_path):
    record = RunRecord(tmp_path, description())
    record.close("FAILED")
    again = RunRecord(tmp_path, description())
    ModelRecord(again).made(EPISODES, "ingest")
    again.close("FINISHED")
    assert events(again) == [RUN, END, RESUMED, MADE, END]


def test_other_code_or_configuration_is_another_run(tmp_path):
    keys = {RunRecord(tmp_path, description(code=code)).journal.key for code in ("a", "b")}
    assert len(keys) == 2


def test_parent_shows_the_datasets_of_its_children_but_not_their_models(tmp_path):
    parent = RunRecord(tmp_path, description("BC"))
    child = ModelRecord(RunRecord(tmp_path, description(), parent))
    child.made(EPISODES, "ingest")
    child.made(CHECKPOINT, "train")
    assert events(parent) == [RUN, MADE]


def test_curves_of_later_rounds_have_names_of_their_own(tmp_path):
    record = RunRecord(tmp_path, description())
    model = ModelRecord(record)
    model.metrics("train").log({"train/loss": 1.0}, 10)
    model.for_round(2).metrics("train").log({"train/loss": 0.5}, 10)
    metrics = [entry.content["metrics"] for entry in record.journal.entries() if entry.content["event"] == METRICS]
    assert metrics == [{"train/loss": 1.0}, {"round_2/train/loss": 0.5}]


def test_half_a_line_left_by_a_kill_swallows_nothing(tmp_path):
    record = RunRecord(tmp_path, description())
    record.journal.finish()
    with record.journal.path.open("a") as file:
        file.write('{"event": "metr')
    again = RunRecord(tmp_path, description())
    ModelRecord(again).made(EPISODES, "ingest")
    assert events(again) == [RUN, MADE]


@pytest.mark.parametrize("content", ["", "{", "[]", "null", '{"offset": "7"}', '{"nonsense": 1}'])
def test_a_state_of_delivery_that_is_nonsense_means_that_nothing_was_delivered(tmp_path, content):
    journal = Journal(tmp_path, "run")
    (tmp_path / "run.state.json").write_text(content)
    assert DeliveryState.load(journal) == DeliveryState()


def test_killed_run_is_written_down_as_killed_once_its_writer_is_gone(tmp_path):
    record = RunRecord(tmp_path, description())
    Journal(tmp_path, record.journal.key).bury()
    assert events(record) == [RUN]
    record.journal.finish()
    for _ in range(2):
        Journal(tmp_path, record.journal.key).bury()
    assert events(record) == [RUN, END]


def test_journal_that_cannot_be_written_stops_nothing(tmp_path, caplog):
    (tmp_path / "file").touch()
    record = RunRecord(tmp_path / "file" / "tracking", description())
    record.measured({"train/loss": 1.0}, 1)
    record.close("FINISHED")
    assert "cannot be written" in caplog.text


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "tracking"


def deliver(folder, store, uri, artifact_root=None):
    warnings = []
    courier = Courier(folder, Destination(uri, artifact_root), store, warnings.append)
    courier.start()
    return courier.finish(100), warnings


def test_database_that_cannot_be_used_costs_a_sentence_and_nothing_is_lost(folder, store, tmp_path, toys, session):
    episodes = toys.write(session, config=toys.ToyConfig(words=2))
    parent = RunRecord(folder, description("BC"))
    record = RunRecord(folder, description(), parent)
    model = ModelRecord(record)
    model.made(episodes, "write")
    for step in range(3):
        model.metrics("train").log({"train/loss": 1.0 / (step + 1)}, step)
    record.close("FINISHED")
    parent.result({"success_rate": 0.5}, "| a |\n|---|\n")
    parent.close("FINISHED")

    (tmp_path / "file").touch()
    done, (warning,) = deliver(folder, store, f"sqlite:///{tmp_path / 'file' / 'mlflow.db'}")
    assert not done
    assert "cannot be used" in warning
    assert "records wait in" in warning

    done, (warning,) = deliver(folder, store, "http://127.0.0.1:9")
    assert not done
    assert "MLflow at 'http://127.0.0.1:9' cannot be used ([Errno 111] Connection refused)" in warning

    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    assert deliver(folder, store, uri, tmp_path / "files") == (True, [])
    client, child = _look(uri, record.journal)
    assert child.info.status == "FINISHED"
    assert child.data.metrics["train/loss"] == pytest.approx(1 / 3)
    assert child.data.params == {"train.training.steps": "10"}
    (dataset,) = [entry.dataset for entry in child.inputs.dataset_inputs]
    assert dataset.digest == episodes.id
    assert json.loads(dataset.profile)["made_by"] == "stage write"
    above = client.get_run(child.data.tags["mlflow.parentRunId"])
    assert above.data.metrics["success_rate"] == 0.5
    assert [entry.dataset.digest for entry in above.inputs.dataset_inputs] == [episodes.id]

    assert deliver(folder, store, uri, tmp_path / "files") == (True, [])
    assert len(client.get_metric_history(child.info.run_id, "train/loss")) == 3


def test_kill_among_the_migrations_leaves_a_database_that_can_be_used(folder, tmp_path):
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    code = "import sys; from pathlib import Path; from stages.tracking.courier import *; "
    code += "initialise(Path(sys.argv[1]), Destination(sys.argv[2]))"
    process = subprocess.Popen([sys.executable, "-c", code, str(folder), uri], stderr=subprocess.DEVNULL)
    while process.poll() is None and not (tmp_path / "mlflow.db.draft").exists():
        time.sleep(0.01)
    time.sleep(0.2)
    process.kill()
    assert process.wait() == -9
    initialise(folder, Destination(uri))
    assert [path.name for path in tmp_path.glob("mlflow.db*")] == ["mlflow.db"]
    with sqlite3.connect(tmp_path / "mlflow.db") as database:
        assert database.execute("select count(*) from registered_models").fetchone() == (0,)


def _look(uri, journal):
    from mlflow import MlflowClient

    client = MlflowClient(uri)
    return client, client.get_run(DeliveryState.load(journal).run_id)
