"""What a run would do is told before it starts, with the setting at the root of every computation."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from flows.command.cli import call
from flows.command.preview import preview, total_seconds
from flows.running.plan import explainer, plan
from flows.runs import load_runs
from juicer.artifacts.store import ArtifactStore
from juicer.tasks.registry import TASK_NAMES

DEMO = Path(__file__).parents[3] / "configs" / "demo.yaml"


def config_with(*overrides):
    (config,) = load_runs(DEMO, overrides)
    return config


def planned_with(store, *overrides):
    return plan(store, config_with(*overrides))


def make_all(store, planned):
    """Everything that was planned, without its content."""
    for entry in planned:
        with store.create(entry.call.recipe):
            pass


@pytest.fixture
def store(tmp_path):
    """The artifacts of the demonstration's study, as if it had run."""
    store = ArtifactStore(tmp_path / "data")
    make_all(store, planned_with(store))
    make_all(store, [entry for entry in planned_with(store) if not entry.exists])
    return store


def explained(store, stage, *overrides):
    config = config_with(*overrides)
    planned = plan(store, config)
    explaining = explainer(store, planned)
    return {entry.label: explaining.explain(entry.call.recipe) for entry in planned if entry.stage == stage}


def refs(store, stage):
    return {entry.label: entry.ref for entry in planned_with(store) if entry.stage == stage}


def test_like_is_compared_with_like_down_to_the_changed_key(store):
    found = explained(store, "evaluate", "record.demonstrations=40")
    assert {label: each.nearest.ref for label, each in found.items()} == refs(store, "evaluate")
    bc, ta_ci = found.values()
    changed = "config key 'record.demonstrations' is 40, it was 50"
    assert bc.reasons == [f"{changed}, so ingest, dataset, train and evaluate are computed again"]
    (reason,) = ta_ci.reasons
    assert reason.startswith(f"{changed}, so ingest, ")
    assert {"annotate", "augment", "train", "collect", "select", "evaluate"} <= set(reason.replace(",", "").split())


def test_training_before_and_after_a_round_are_told_apart(store):
    found = explained(store, "train", "policies.diffusion.training.steps=9000")
    assert {label: each.nearest.ref for label, each in found.items()} == refs(store, "train")
    assert {each.reasons[0] for each in found.values()} == {
        "config key 'policies.diffusion.training.steps' is 9000, it was 8000"
    }


def test_corrective_episodes_of_retraining_are_told_from_those_of_training(store):
    (before, after) = ("augment_retraining={num_snippets: 150}", "augment_retraining={num_snippets: 250}")
    make_all(store, [entry for entry in planned_with(store, before) if not entry.exists])
    (found,) = [each for each in explained(store, "augment", after).values() if not each.hit]
    assert found.reasons == ["config key 'augment_retraining.num_snippets' is 250, it was 150"]


def test_several_changes_are_each_named_once(store):
    (found,) = explained(store, "collect", "augment.num_snippets=100", "ingest.min_steps=30").values()
    assert found.reasons == [
        "config key 'ingest.min_steps' is 30, it was 50, "
        "so annotate, augment, dataset, train and collect are computed again",
        "config key 'augment.num_snippets' is 100, it was 864, so dataset, train and collect are computed again",
    ]


def test_changed_code_is_told_by_module(store):
    planned = planned_with(store)
    (evaluate, *_) = [entry.call.recipe for entry in planned if entry.stage == "evaluate"]
    changed = replace(evaluate, code="new", modules={**evaluate.modules, "juicer.evaluation": "new"})
    explanation = explainer(store, planned).explain(changed)
    assert explanation.reasons == ["code of 'juicer.evaluation' changed"]
    assert explanation.nearest.ref == evaluate.ref


def test_a_dry_run_tells_what_is_reused_and_why_the_rest_is_not(store):
    (config,) = load_runs(DEMO, ["augment.num_snippets=100"])
    (calls,) = preview(store, [config])
    calls = {(each.stage, each.label): each for each in calls}
    assert calls["train", "bc seed 0"].is_reused
    assert calls["augment", "ta_ci seed 0"].reason == "config key 'augment.num_snippets' is 100, it was 864"
    assert calls["evaluate", "ta_ci seed 0 round 1"].reason == calls["augment", "ta_ci seed 0"].reason
    assert calls["train", "ta_ci seed 0"].seconds is not None
    assert calls["report", ""].ref is None


@pytest.mark.parametrize(
    ("stage", "setting", "share"),
    [
        ("record", "record.demonstrations=25", 1 / 2),
        ("augment", "augment.num_snippets=1728", 2),
        ("train", "policies.diffusion.training.steps=24000", 3),
        ("collect", "collect.successes=10", 1 / 5),
        ("evaluate", "evaluate.episodes=400", 4),
        ("annotate", "annotate.critical_states=task", 1),
    ],
)
def test_a_stage_that_has_more_to_do_is_said_to_take_longer(store, stage, setting, share):
    found = explained(store, stage, setting).items()
    expected = {label: each.nearest.seconds * share for label, each in found if each.nearest}
    (calls,) = preview(store, [config_with(setting)])
    told = {each.label: each.seconds for each in calls if each.stage == stage and not each.is_reused}
    assert told == pytest.approx(expected)
    assert told


@pytest.mark.parametrize("settings", [{}, {"training": 8000}, {"training": {"steps": "many"}}])
def test_an_artifact_of_a_time_with_other_settings_tells_how_long_the_like_took(tmp_path, settings):
    store = ArtifactStore(tmp_path / "data")
    train = next(entry.call.recipe for entry in planned_with(store) if entry.stage == "train")
    with store.create(replace(train, config=settings)):
        pass
    (calls,) = preview(store, [config_with()])
    assert {each.seconds for each in calls if each.stage == "train"} == {store.list()[0].seconds}


def test_a_dry_run_of_everything_there_has_nothing_to_compute(store):
    (config,) = load_runs(DEMO)
    (calls,) = preview(store, [config])
    assert all(each.is_reused and not each.reason for each in calls)
    assert calls[-1].stage == "report"
    assert total_seconds([calls], workers=2) == 0


def test_an_estimate_is_no_shorter_than_the_longest_chain_or_than_all_work_together(store):
    (config,) = load_runs(DEMO, ["record.demonstrations=40"])
    (calls,) = preview(store, [config])
    calls = [replace(each, seconds=10.0, ends=0.0) for each in calls]
    assert total_seconds([calls], workers=2) == 5.0 * len(calls)
    longer = [replace(calls[0], ends=90.0), *calls[1:]]
    assert total_seconds([longer], workers=2) == 90.0
    # The run for one task begins when that for another has ended.
    assert total_seconds([longer, calls], workers=2) == 90.0 + 5.0 * len(calls)


def test_what_runs_for_several_tasks_share_is_told_once_and_the_rest_by_task(store):
    runs = [run.narrowed(["multitask"], [0]) for run in load_runs("table_vi")]
    calls = [call for calls in preview(store, runs) for call in calls]
    made = [call.ref for call in calls if call.ref]
    assert len(made) == len(set(made))
    assert Counter(call.task for call in calls if call.stage == "evaluate") == dict.fromkeys(TASK_NAMES, 1)
    labels = [(call.stage, call.label) for call in calls]
    assert len(labels) == len(set(labels))
    assert labels[-1] == ("report", "square_table")


def test_a_stage_that_only_one_of_several_tasks_has_is_told_of_that(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("JUICER_DATA", str(tmp_path / "data"))
    assert call(["explain", "sampling", "--config", "paper_study", "--seed", "0", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {each["task"] for each in told} == {"one_leg"}
    assert call(["explain", "train", "--config", "table_vi", "--condition", "multitask", "--seed", "0", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert len({each["ref"] for each in told}) == len(told)


def test_the_command_starts_nothing_and_writes_nothing(tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("JUICER_DATA", str(tmp_path / "data"))
    before = sorted(tmp_path.rglob("*"))
    assert call(["run", str(DEMO), "--dry-run"]) == 0
    assert call(["run", str(DEMO), "--dry-run", "--json"]) == 0
    out, err = capfd.readouterr()
    assert sorted(tmp_path.rglob("*")) == before
    assert err == ""
    table, _, content = out.partition("\n{")
    assert "0 reused, 15 to be computed: none like them ever ran, so nobody knows how long they take" in table
    found = json.loads("{" + content)
    assert (found["reused"], found["computed"], found["unknown"], found["lacks"]) == (0, 15, 15, "")
    assert "refused" not in table
    assert [each["stage"] for each in found["calls"]][:4] == ["record", "ingest", "dataset", "train"]


def test_what_a_run_would_be_refused_for_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("JUICER_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("JUICER_WEIGHTS", str(tmp_path / "none"))
    assert call(["run", "paper_image", "--dry-run"]) == 0
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("the run would be refused: "))
    assert "resnet18-f37072fd.pth' are not on this machine" in line
