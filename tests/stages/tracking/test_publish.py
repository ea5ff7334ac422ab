"""MLflow shows what artifacts tell, once, and never stands in the way."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.storage.curves import read_curves
from stages.tracking.destination import MODELS_VIEW, VIEW, newest_study, runs_page
from stages.tracking.model import noted
from stages.tracking.publish import NOTE, publish
from stages.tracking.run_writer import COMPLETE, RunWriter

ROOT = Path(__file__).parents[3]

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")


def runs_of(client, study="study", view=1):
    experiment = client.get_experiment_by_name(study)
    return {run.info.run_name: run for run in client.search_runs([experiment.experiment_id], run_view_type=view)}


def show(destination, store, models):
    client = destination.connect()
    published = publish(client, store, models, destination.artifact_root)
    assert published.problems == []
    return client


def counts(client, name, metric="train/loss"):
    return len(client.get_metric_history(runs_of(client)[name].info.run_id, metric))


def test_success_has_one_name_for_every_condition_over_five_seeds(destination, store, study):
    client = show(destination, store, study.models())
    runs = runs_of(client)
    labels = [f"{title}, seed {seed}" for title in ("BC", "TA+CI") for seed in range(5)]
    assert set(runs) == {"BC", "TA+CI", *labels}
    for label in labels:
        metrics = runs[label].data.metrics
        assert metrics["success_rate_low"] < metrics["success_rate"] < metrics["success_rate_high"]
        assert metrics["episodes"] == 100
    average = sum(runs[f"TA+CI, seed {seed}"].data.metrics["success_rate"] for seed in range(5)) / 5
    assert runs["TA+CI"].data.metrics["success_rate"] == pytest.approx(average)
    assert runs["TA+CI"].data.metrics["models"] == 5
    assert runs["TA+CI, seed 3"].data.tags["mlflow.parentRunId"] == runs["TA+CI"].info.run_id
    assert {run.info.status for run in runs.values()} == {"FINISHED"}


def test_rates_under_shifts_stand_below_their_names(destination, store, study):
    other = study.model("ta_ci", 7).evaluation
    models = [
        model.model_copy(update={"shifted": {"push": other}, "unnoticed": ("light",)})
        for model in study.models(range(2))
    ]
    runs = runs_of(show(destination, store, models))
    pushed = store.manifest(ArtifactRef.parse(other)).summary
    for label in ("BC, seed 1", "TA+CI"):
        metrics = runs[label].data.metrics
        assert metrics["under_push/success_rate"] == pytest.approx(pushed["success_rate"])
        assert metrics["under_push/success_rate_low"] < metrics["under_push/success_rate"]
        assert not any(name.startswith("under_light") for name in metrics)
    assert runs["BC"].data.metrics["success_rate"] < runs["BC"].data.metrics["under_push/success_rate"]


def test_a_shift_that_is_added_later_is_shown_with_the_models_that_are_there(destination, store, study):
    usual = study.models(range(1))
    show(destination, store, usual)
    other = study.model("ta_ci", 7).evaluation
    runs = runs_of(show(destination, store, [model.model_copy(update={"shifted": {"push": other}}) for model in usual]))
    assert sorted(runs) == sorted(runs_of(show(destination, store, usual)))
    for label in ("BC, seed 0", "BC"):
        assert "under_push/success_rate" in runs[label].data.metrics


def test_rounds_before_the_final_model_stand_below_their_number(destination, store, study):
    client = show(destination, store, study.models(range(1)))
    runs = runs_of(client)
    metrics = runs["TA+CI, seed 0"].data.metrics
    assert metrics["round_1/collect/success_rate"] == 0.4
    assert metrics["round_1/select/kept"] == 50
    assert {"train/loss", "round_1/train/loss", "train/steps", "round_1/train/steps"} <= set(metrics)
    assert metrics["augment/snippets"] == 150
    assert not [name for name in runs["BC, seed 0"].data.metrics if name.startswith("round_")]


def test_publishing_again_changes_nothing(destination, store, study):
    models = study.models(range(2))
    client = show(destination, store, models)
    before = {name: run.to_dictionary() for name, run in runs_of(client).items()}
    show(destination, store, models)
    assert {name: run.to_dictionary() for name, run in runs_of(client).items()} == before
    assert counts(client, "BC, seed 0") == 49
    assert len(client.search_model_versions("name = 'study.bc'")) == 2


def test_what_a_kill_left_half_done_is_completed(destination, store, study):
    (model,) = [study.model()]
    client = show(destination, store, [model])
    run = runs_of(client)["BC, seed 0"].info.run_id
    client.delete_tag(run, COMPLETE)
    points = len(read_curves(store.open(ArtifactRef.parse(checkpoint_of(store, model))))["train/loss"][0])
    show(destination, store, [model])
    assert counts(client, "BC, seed 0") == points
    assert len(client.search_model_versions("name = 'study.bc'")) == 1
    assert runs_of(client)["BC, seed 0"].data.tags[COMPLETE] == model.evaluation


def checkpoint_of(store, model):
    return str(store.manifest(ArtifactRef.parse(model.evaluation)).recipe.inputs["checkpoint"][0])


def test_what_was_deleted_in_mlflow_stays_so_and_keeps_nothing_else_from_being_shown(destination, store, study):
    client = show(destination, store, [study.model(seed=0)])
    client.delete_run(runs_of(client)["BC, seed 0"].info.run_id)
    show(destination, store, [study.model(seed=0), study.model(seed=1)])
    assert set(runs_of(client)) == {"BC", "BC, seed 1"}
    experiment = client.get_experiment_by_name("study").experiment_id
    client.delete_experiment(experiment)
    study.name = "other"
    old, new = study.model(seed=0).model_copy(update={"study": "study"}), study.model(seed=1)
    published = publish(client, store, [old, new], destination.artifact_root)
    assert published.problems == [
        "the experiment 'study' was deleted in MLflow, so nothing is recorded in it; bring it back with "
        f"`mlflow experiments restore -x {experiment}`, or give the study another name"
    ]
    assert set(runs_of(client, "other")) == {"BC", "BC, seed 1"}


def test_a_removed_database_is_filled_again(destination, store, study, data, empty_database):
    models = study.models(range(1))
    before = set(runs_of(show(destination, store, models)))
    shutil.copyfile(empty_database, data / "mlflow.db")
    assert set(runs_of(show(destination, store, models))) == before


def test_a_lost_artifact_concerns_its_own_model_only(destination, store, study):
    lost, kept = study.model(seed=0), study.model(seed=1)
    shutil.rmtree(store.open(ArtifactRef.parse(lost.evaluation)))
    client = destination.connect()
    published = publish(client, store, [lost, kept], destination.artifact_root)
    (problem,) = published.problems
    assert problem.startswith("MLflow does not show BC, seed 0 of 'study': ")
    assert set(runs_of(client)) == {"BC", "BC, seed 1"}


def test_a_model_that_is_lost_since_counts_no_more_and_holds_nothing_up(destination, store, study):
    lost, kept, added = (study.model(seed=seed) for seed in range(3))
    show(destination, store, [lost, kept])
    shutil.rmtree(store.open(ArtifactRef.parse(lost.evaluation)))
    client = destination.connect()
    published = publish(client, store, [lost, kept, added], destination.artifact_root)
    (problem,) = published.problems
    assert problem.startswith("BC, seed 0 of 'study' does not count in MLflow's averages any more: ")
    assert runs_of(client)["BC"].data.metrics["models"] == 2
    assert "| 2 | 200 |" in client.get_experiment_by_name("study").tags[NOTE]


def test_what_is_shown_already_is_not_read_again(destination, store, study):
    models = study.models(range(1))
    client = show(destination, store, models)
    before = client.get_experiment_by_name("study").tags
    for model in models:
        shutil.rmtree(store.open(ArtifactRef.parse(model.evaluation)))
    show(destination, store, models)
    assert client.get_experiment_by_name("study").tags == before


@pytest.mark.parametrize("content", ["", "{", "[]", "null", '{"study": 7}', '{"nonsense": 1}', "[" * 10_000])
def test_notes_that_are_nonsense_are_overlooked(tmp_path, store, study, content):
    study.model().note(tmp_path)
    (tmp_path / "0-bc-0.model.json").write_text(content)
    (tmp_path / "folder.model.json").mkdir()
    assert [model.label for model in noted(tmp_path)] == ["BC, seed 0"]


PUBLISHING = """
import sys
from pathlib import Path
from juicer.artifacts.store import ArtifactStore
from stages.tracking.destination import Destination
from stages.tracking.destination import newest_study, runs_page
from stages.tracking.model import noted
from stages.tracking.publish import publish
data = Path(sys.argv[1])
place = Destination(f"sqlite:///{data / 'mlflow.db'}", data / "tracking" / "here", data / "mlflow-files")
client = place.initialise()
assert publish(client, ArtifactStore(data), noted(place.folder), place.artifact_root).problems == []
experiment = client.get_experiment_by_name("study")
for run in client.search_runs([experiment.experiment_id]):
    print(run.info.run_name, len(client.list_artifacts(run.info.run_id, "model")))
"""


def publish_elsewhere(data):
    """In a process of its own: MLflow remembers for the rest of a process where the files of a run are."""
    done = subprocess.run(
        [sys.executable, "-c", PUBLISHING, str(data)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return sorted(done.stdout.splitlines())


def test_a_copied_data_folder_delivers_nothing_twice_and_writes_nothing_to_the_old_place(tmp_path, data, study):
    notes = data / "tracking" / "here"
    study.store = ArtifactStore(data)
    for model in study.models(range(1)):
        model.note(notes)
    shown = ["BC 0", "BC, seed 0 5", "TA+CI 0", "TA+CI, seed 0 5"]
    assert publish_elsewhere(data) == shown
    copy = tmp_path / "copy"
    shutil.move(data, copy)
    study.store = ArtifactStore(copy)
    study.model(seed=7).note(copy / "tracking" / "here")
    assert publish_elsewhere(copy) == sorted([*shown, "BC, seed 7 5"])
    assert not data.exists()


def test_the_address_that_is_printed_opens_a_view_with_success_in_front(destination, store, study):
    assert runs_page("http://127.0.0.1:5000", newest_study(destination.connect())).endswith("/#/experiments")
    client = show(destination, store, [study.model()])
    experiment = client.get_experiment_by_name("study")
    page = runs_page("http://127.0.0.1:5000/", newest_study(client))
    view = page.rpartition("=")[2]
    assert page == f"http://127.0.0.1:5000/#/experiments/{experiment.experiment_id}/runs?viewStateShareKey={view}"
    state = json.loads(experiment.tags[f"mlflow.sharedViewState.{view}"])
    assert (state["orderByKey"], state["orderByAsc"]) == ("metrics.`success_rate`", False)
    assert state["selectedColumns"][0] == "metrics.`success_rate`"
    assert "**BC " in experiment.tags["mlflow.note.content"]


def test_one_view_groups_models_by_condition_and_one_shows_each_in_the_colour_of_its_condition(
    destination, store, study
):
    client = show(destination, store, study.models(range(2)))
    tags = client.get_experiment_by_name("study").tags
    by_condition, each = (json.loads(tags[f"mlflow.sharedViewState.{view}"]) for view in (VIEW, MODELS_VIEW))
    (key,) = by_condition["groupBy"]["groupByKeys"]
    assert (key, each["groupBy"]) == ({"mode": "param", "groupByData": "condition"}, None)
    runs = runs_of(client)
    models = {name for name in runs if "seed" in name}
    shown = client.search_runs([client.get_experiment_by_name("study").experiment_id], each["searchFilter"])
    assert {run.info.run_name for run in shown} == models
    drawn = {key for chart in by_condition["compareRunCharts"] for key in chart.get("selectedMetricKeys", ())}
    known = {name for run in runs.values() for name in run.data.metrics} | {"validation/position_error_mm"}
    assert drawn <= known | {"validation/loss"}
    # What only a parent has, the average over its group leaves as it is.
    assert [name for name, run in runs.items() if "condition_rate_low" in run.data.metrics] == ["TA+CI", "BC"]
    colours = {name: run.data.tags["mlflow.runColor"] for name, run in runs.items()}
    assert colours["BC, seed 0"] == colours["BC, seed 1"] == colours["BC"] != colours["TA+CI, seed 0"]
    assert f"viewStateShareKey={MODELS_VIEW}&" in tags["mlflow.note.content"]


def test_durations_are_what_the_stages_of_the_model_took(destination, store, study):
    client = show(destination, store, [study.model()])
    run = runs_of(client)["BC, seed 0"]
    evaluation = store.manifest(ArtifactRef.parse(study.model().evaluation))
    trained = store.manifest(ArtifactRef.parse(checkpoint_of(store, study.model())))
    assert run.info.end_time - run.info.start_time == round(1000 * (evaluation.seconds + trained.seconds))


def test_datasets_have_the_digests_of_artifacts_and_parents_show_them_too(destination, store, study):
    runs = runs_of(show(destination, store, study.models(range(1))))
    for name in ("TA+CI", "TA+CI, seed 0"):
        shown = {entry.dataset.digest for entry in runs[name].inputs.dataset_inputs}
        assert study.episodes().id in shown
        assert len(shown) == 8


def test_lineage_is_a_page_that_needs_no_other_and_the_report_is_linked(destination, store, study):
    client = show(destination, store, study.models(range(1)))
    runs = runs_of(client)
    folder = destination.artifact_root / "study"
    page = (folder / runs["TA+CI, seed 0"].info.run_id / "artifacts" / "lineage.html").read_text()
    assert "<style>" in page
    assert "TA+CI, seed 0" in page
    assert f'<a href="#{study.episodes()}">' in page
    host = runs["BC"].info.run_id
    assert (folder / host / "artifacts" / "report" / "report.html").is_file()
    note = client.get_experiment_by_name("study").tags["mlflow.note.content"]
    assert f"/runs/{host}/artifacts/report/report.html" in note
    assert "| TA+CI |" in note


def page_of(client, study="study"):
    return client.get_experiment_by_name(study).tags[NOTE]


def hosts_of(client):
    """Runs that keep a report."""
    runs = client.search_runs([client.get_experiment_by_name("study").experiment_id])
    return [run.info.run_name for run in runs if client.list_artifacts(run.info.run_id, "report")]


def test_the_study_is_told_with_the_newest_models_of_each_condition_and_its_report_is_kept_once(
    destination, store, study
):
    models = study.models(range(2))
    changed = [model.model_copy(update={"identity": "2" * 16}) for model in models if model.condition == "bc"][:1]
    counts = []
    for order in ([*models, *changed], [*changed, *models]):
        client = show(destination, store, order)
        note = page_of(client)
        assert note.startswith("**BC ")
        assert ", TA+CI " in note.partition("**;")[0]
        counts += re.findall(r"\| BC .*\| (\d+) \| \d+ \|$", note, re.M)
    assert counts == ["1", "2"]
    assert hosts_of(client) == ["BC"]


def test_models_of_another_task_do_not_stand_beside_each_other(destination, store, study):
    other = [each.model_copy(update={"task": "lamp", "identity": "3" * 16}) for each in study.models(range(1))[:1]]
    assert "| TA+CI |" not in page_of(show(destination, store, [*study.models(range(1)), *other]))


def test_the_report_is_where_the_link_leads_when_its_run_has_got_another_one_or_is_deleted(destination, store, study):
    models = study.models(range(1))
    show(destination, store, models)
    alone = study.put("report", "report", lambda folder: (folder / "report.html").write_text("BC"), {"alone": True})
    newer = [each.model_copy(update={"report": str(alone)}) if each.condition == "bc" else each for each in models]
    client = show(destination, store, [*newer, study.model("ta_ci", 1).model_copy(update={"report": models[0].report})])
    runs = runs_of(client)
    assert f"/runs/{runs['TA+CI'].info.run_id}/artifacts/report/" in page_of(client)
    assert sorted(hosts_of(client)) == ["BC", "TA+CI"]
    client.delete_run(runs["TA+CI"].info.run_id)
    client = show(destination, store, models)
    assert f"/runs/{runs['BC'].info.run_id}/artifacts/report/" in page_of(client)


def test_a_report_stays_while_the_run_that_made_it_is_repeated(tmp_path, store, study):
    (model, *_) = study.models(range(1))
    model.note(tmp_path)
    model.model_copy(update={"report": ""}).note(tmp_path)
    assert [each.report for each in noted(tmp_path)] == [model.report]
    measured = model.model_copy(update={"report": "", "shifted": {"push": model.evaluation}})
    measured.note(tmp_path)
    assert [each.report for each in noted(tmp_path)] == [""]


def test_what_was_noted_last_is_the_newest_whatever_the_files_say(tmp_path, store, study):
    for model in (study.model("ta_ci", 0), study.model("bc", 0)):
        model.note(tmp_path)
    os.utime(next(tmp_path.glob("*bc*")), (1, 1))
    assert [model.condition for model in noted(tmp_path)] == ["ta_ci", "bc"]


def test_a_kill_between_the_tags_of_a_study_leaves_a_note_that_is_known_as_ours(destination, store, study, monkeypatch):
    client = show(destination, store, [study.model(seed=0)])

    def killed(self, experiment, key, value):
        if key == NOTE:
            raise KeyboardInterrupt
        set_tag(self, experiment, key, value)

    set_tag = type(client).set_experiment_tag
    monkeypatch.setattr(type(client), "set_experiment_tag", killed)
    with pytest.raises(KeyboardInterrupt):
        show(destination, store, [study.model(seed=0), study.model(seed=1)])
    monkeypatch.undo()
    assert "| 1 | 100 |" in page_of(client)
    assert "| 2 | 200 |" in page_of(show(destination, store, [study.model(seed=0), study.model(seed=1)]))


def test_a_note_that_somebody_changed_is_kept(destination, store, study):
    client = show(destination, store, [study.model()])
    experiment = client.get_experiment_by_name("study").experiment_id
    client.set_experiment_tag(experiment, "mlflow.note.content", "my own words")
    show(destination, store, [study.model(), study.model(seed=1)])
    assert client.get_experiment(experiment).tags["mlflow.note.content"] == "my own words"


LOADING = """
import sys, pickle, numpy as np, pandas as pd, mlflow
def refuse(*_, **__): raise AssertionError("something was unpickled")
class Refusing(pickle.Unpickler):
    load = refuse
pickle.load, pickle.loads, pickle.Unpickler = refuse, refuse, Refusing
mlflow.set_tracking_uri(sys.argv[1])
rows = {"proprioception": np.zeros((2, 16), "float32"), "part_poses": np.tile([0, 0, 0, 1, 0, 0, 0], (2, 2))}
rows["proprioception"][:, 3:9] = (1, 0, 0, 0, 1, 0)
frame = pd.DataFrame({name: list(values) for name, values in rows.items()})
for given in (rows, frame):
    policy = mlflow.pyfunc.load_model(sys.argv[2])
    print(policy.predict(given).shape, float(policy.predict(given).sum()))
"""


def test_a_registered_version_is_told_from_others_and_loads_without_unpickling(destination, store, study, tmp_path):
    client = show(destination, store, study.models(range(3)))
    versions = {each.tags["seed"]: each for each in client.search_model_versions("name = 'study.ta_ci'")}
    assert set(versions) == {"0", "1", "2"}
    rates = {seed: float(each.tags["success_rate"]) for seed, each in versions.items()}
    best = client.get_model_version_by_alias("study.ta_ci", "best")
    assert float(best.tags["success_rate"]) == max(rates.values())
    assert client.get_model_version_by_alias("study.ta_ci", "last").version == max(v.version for v in versions.values())
    assert best.tags["study"] == "study"
    assert best.tags["condition"] == "ta_ci"
    files = [file.path for file in client.list_artifacts(best.run_id, "model")]
    names = ("MLmodel", "curves.json", "manifest.json", "policy.json", "weights.safetensors")
    assert sorted(files) == [f"model/{name}" for name in names]
    command = [sys.executable, "-c", LOADING, destination.uri, "models:/study.ta_ci@best"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == lines[1]
    assert lines[0].startswith("(2, ")
    assert json.loads(lines[0].split(") ")[1]) != 0


def test_a_version_tells_what_its_model_was_found_to_do_at_last(destination, store, study):
    for episodes in (25, 100):
        client = show(destination, store, [study.model(episodes_evaluated=episodes)])
    (version,) = client.search_model_versions("name = 'study.bc'")
    assert version.tags["episodes"] == "100"
    assert float(version.tags["success_rate"]) == runs_of(client)["BC, seed 0"].data.metrics["success_rate"]


def test_a_model_that_was_trained_anew_leaves_the_earlier_one_its_run_and_its_version(destination, store, study):
    first, other = study.model("bc", 0), study.model("bc", 1)
    client = show(destination, store, [first])
    run = runs_of(client)["BC, seed 0"]
    weights = client.download_artifacts(run.info.run_id, "model/weights.safetensors")
    before = Path(weights).read_bytes()
    # As after other labels or another release of a library: the same model by its configuration.
    again = first.model_copy(update={"evaluation": other.evaluation})
    show(destination, store, [again])
    show(destination, store, [again])
    runs = runs_of(client)
    assert set(runs) == {"BC", "BC, seed 0", "BC, seed 0 (earlier)"}
    assert runs["BC, seed 0 (earlier)"].info.run_id == run.info.run_id
    assert runs["BC, seed 0 (earlier)"].data.metrics == run.data.metrics
    assert Path(client.download_artifacts(run.info.run_id, "model/weights.safetensors")).read_bytes() == before
    versions = {each.tags["artifact"]: each.run_id for each in client.search_model_versions("name = 'study.bc'")}
    assert versions == {
        checkpoint_of(store, first): run.info.run_id,
        checkpoint_of(store, other): runs["BC, seed 0"].info.run_id,
    }
    assert counts(client, "BC, seed 0") == 49
    # Another data folder, or the former labels again: what is shown is found.
    for model in (first, again, first):
        show(destination, store, [model])
    assert {name: run.info.run_id for name, run in runs_of(client).items()} == {
        name: run.info.run_id for name, run in runs.items()
    }
    assert len(client.search_model_versions("name = 'study.bc'")) == 2


@pytest.mark.parametrize("values", [(1.0, 0.75), (0.75, 1.0)])
def test_of_two_values_at_one_time_the_last_one_is_shown(destination, store, study, values):
    client = show(destination, store, [study.model()])
    for value in values:
        RunWriter(client, store).numbers(runs_of(client)["BC"], {"success_rate": value}, 1000)
    assert runs_of(client)["BC"].data.metrics["success_rate"] == values[-1]


def note_of(client):
    return runs_of(client)["BC, seed 0"].data.tags[NOTE]


def test_record_links_to_the_pages_where_they_are_served_now(destination, store, study):
    models = [study.model("bc", 0)]
    client = show(destination, store, models)
    assert "/lineage?artifact=" not in note_of(client)
    for address in ("http://127.0.0.1:8000", "http://127.0.0.1:8001"):
        assert publish(client, store, models, destination.artifact_root, address).problems == []
        assert f"({address}/lineage?artifact={models[0].evaluation})" in note_of(client)
    show(destination, store, models)
    assert "http://127.0.0.1:8001" in note_of(client)


def test_a_deleted_run_is_not_linked_and_nothing_is_said_of_it(destination, store, study):
    models = [study.model("bc", 0), study.model("bc", 1)]
    client = show(destination, store, models)
    client.delete_run(runs_of(client)["BC, seed 0"].info.run_id)
    published = publish(client, store, models, destination.artifact_root, "http://127.0.0.1:8000")
    assert published.problems == []


def test_note_that_somebody_changed_is_not_linked(destination, store, study):
    models = [study.model("bc", 0)]
    client = show(destination, store, models)
    client.set_tag(runs_of(client)["BC, seed 0"].info.run_id, NOTE, "mine")
    publish(client, store, models, destination.artifact_root, "http://127.0.0.1:8000")
    assert note_of(client) == "mine"
