"""Models run side by side; what goes wrong in one is no reason to lose the others."""

from __future__ import annotations

import threading
from collections import Counter
from pathlib import Path

import pytest

from flows.config import StudyConfig
from flows.loop import ModelOutcome
from flows.running import execution
from flows.running.execution import RunOutcome, _facts, execute, run_models
from flows.running.plan import is_complete, plan
from flows.running.tracking import Tracking
from flows.runs import load_runs
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Outcome
from juicer.errors import TrainingFailed
from juicer.reporting.report import configuration_text
from juicer.storage.evaluations import EvaluationRow, write_evaluation
from stages.evaluate import facts
from stages.runtime.context import StageInterrupted
from stages.runtime.session import Session

STUDY = StudyConfig(name="study", conditions=("bc", "ci"), seeds=(0,))


CHECKPOINT, EVALUATION = ArtifactRef("checkpoint", "0" * 16), ArtifactRef("evaluation", "1" * 16)
NOTHING = "no successful rollout to retrain on: none of 4"


class Stub:
    """Performs stage calls in thought, except where it was told otherwise; stages that fail find nothing."""

    def __init__(self, store, errors=None, failing=()):
        self.store, self.errors, self.failing = store, errors or {}, failing
        self.calls, self.lock = [], threading.Lock()

    def __call__(self, call, session):
        with self.lock:
            self.calls.append((call.stage.name, session.label))
        if error := self.errors.get((call.stage.name, session.label)) or self.errors.get(call.stage.name):
            raise error
        if (call.stage.name, session.label) in self.failing or call.stage.name in self.failing:
            with self.store.create(call.recipe) as draft:
                if not draft.adopted:
                    draft.summary |= {"kept": 0, "finding": NOTHING}
        if call.stage.name == "evaluate" and not self.store.find(call.recipe):
            rows = [EvaluationRow(index, 3_000_000 + index, Outcome.SUCCESS, 1, 9) for index in range(4)]
            with self.store.create(call.recipe) as draft:
                # Another model may have needed the same evaluation at the same time.
                if not draft.adopted:
                    write_evaluation(draft.path, rows)
                    draft.summary |= facts(rows, ("screwed",))
        return call.recipe.ref


@pytest.fixture
def store(tmp_path):
    return ArtifactStore(tmp_path / "store")


def test_no_success_to_retrain_on_is_a_finding_not_a_failure(store):
    stub = Stub(store, failing={"select"})
    outcome = RunOutcome(tuple(run_models(Session(store, performer=stub), STUDY)), None)
    bc, ci = outcome.models
    assert (ci.checkpoint, ci.evaluation) == (bc.checkpoint, bc.evaluation)
    assert outcome.findings == ("CI, seed 0: no successful rollout to retrain on: none of 4",)
    assert [(row.condition, row.title) for row in outcome.results(store)] == [("bc", "BC"), ("ci", "CI")]


def test_no_corrective_episode_is_a_finding_and_the_model_learns_from_the_rest(store):
    study = StudyConfig(name="study", conditions=("bc", "ta"), seeds=(0,))
    outcome = RunOutcome(tuple(run_models(Session(store, performer=Stub(store, failing={"augment"})), study)), None)
    bc, ta = outcome.models
    assert ta.checkpoint == bc.checkpoint
    assert outcome.findings == (f"TA, seed 0: {NOTHING}",)


def test_data_that_no_window_reaches_is_a_finding(store):
    stub = Stub(store, failing={("train", "bc seed 0")})
    outcome = RunOutcome(tuple(run_models(Session(store, performer=stub), STUDY, parallel=False)), None)
    assert outcome.findings == (f"BC, seed 0: {NOTHING}",)


def test_a_run_that_ends_with_a_finding_is_complete(store):
    execute(Session(store, performer=Stub(store, failing={"select"})), STUDY, None)

    def make(call, session):
        """What the stub has made in thought, in the store."""
        if store.find(call.recipe) is None:
            with store.create(call.recipe):
                pass
        return call.recipe.ref

    assert not is_complete(store, STUDY)
    execute(Session(store, performer=make), STUDY, None)
    assert is_complete(store, STUDY)
    stages = Counter(entry.stage for entry in plan(store, STUDY))
    assert (stages["train"], stages["select"], stages["report"]) == (1, 1, 1)


def test_seeds_without_a_success_to_retrain_on_count_in_the_average(store):
    study = STUDY.model_copy(update={"seeds": (0, 1)})
    stub = Stub(store, failing={("select", "ci seed 1 round 1")})
    outcome = execute(Session(store, performer=stub), study, None)
    assert [(row.condition, row.num_models) for row in outcome.results(store)] == [("bc", 2), ("ci", 2)]


def test_failure_of_one_model_waits_for_the_others(store):
    stub = Stub(store, {("collect", "ci seed 0 round 1"): TrainingFailed("odd")})
    with pytest.raises(TrainingFailed, match="odd"):
        run_models(Session(store, performer=stub), STUDY)
    assert ("evaluate", "bc seed 0") in stub.calls


def test_interrupt_reaches_the_stages(store):
    session = Session(store, performer=Stub(store, {"train": StageInterrupted()}))
    with pytest.raises(StageInterrupted):
        run_models(session, STUDY)


class Noting:
    """Recorder that keeps what it is told."""

    def __init__(self):
        self.noted, self.logged = {}, []

    def note(self, model):
        self.noted[model.label] = model

    def log(self, model, metrics, step):
        self.logged.append((model.label, metrics, step))


def test_finished_models_are_noted_with_what_no_artifact_says(store):
    noting = Noting()
    outcome = execute(Session(store, performer=Stub(store)), STUDY, Tracking(noting, STUDY))
    assert set(noting.noted) == {"BC, seed 0", "CI, seed 0"}
    model = noting.noted["CI, seed 0"]
    assert (model.study, model.condition, model.task) == ("study", "ci", "one_leg")
    assert model.evaluation == str(outcome.models[1].evaluation)
    assert model.report == str(outcome.report)
    assert model.params["evaluate.episodes"] == STUDY.evaluate.episodes


def test_models_that_finished_are_noted_when_another_fails(store):
    stub, noting = Stub(store, {("collect", "ci seed 0 round 1"): TrainingFailed("odd")}), Noting()
    with pytest.raises(TrainingFailed):
        execute(Session(store, performer=stub), STUDY, Tracking(noting, STUDY))
    assert list(noting.noted) == ["BC, seed 0"]


def test_curves_of_the_final_model_have_the_same_names_whatever_the_condition():
    noting = Noting()
    tracking = Tracking(noting, STUDY)
    retrained = tracking.model("ci", 0)
    for record in (tracking.model("bc", 0), retrained, retrained.for_round(1)):
        record.metrics("train").log({"train/loss": 1.0}, 10)
    assert [list(metrics) for _, metrics, _ in noting.logged] == [
        ["train/loss"],
        ["round_1/train/loss"],
        ["train/loss"],
    ]


def test_other_configuration_is_another_run_in_mlflow():
    longer = STUDY.model_copy(update={"rounds": 2})
    keys = set()
    for config in (STUDY, longer):
        noting = Noting()
        Tracking(noting, config).finish(ModelOutcome("bc", "BC", 0, CHECKPOINT, EVALUATION))
        keys |= {model.key for model in noting.noted.values()}
    assert len(keys) == 2


def test_what_computes_no_model_again_makes_no_other_run_in_mlflow():
    more = {"shifts": {"shoved": {"kind": "push"}}, "analyses": {"watched": {"kind": "monitor"}}}
    keys = set()
    for config in (STUDY, StudyConfig(**{**dict(STUDY), **more}), STUDY.narrowed(["bc"], [0])):
        noting = Noting()
        Tracking(noting, config).finish(ModelOutcome("bc", "BC", 0, CHECKPOINT, EVALUATION))
        keys |= {model.key for model in noting.noted.values()}
    assert len(keys) == 1


def test_outcome_for_machines_names_everything(store):
    outcome = execute(Session(store, performer=Stub(store)), STUDY, None)
    content = outcome.to_json(store)
    assert [model["condition"] for model in content["models"]] == ["bc", "ci"]
    assert content["table"][0]["episodes"] == 4
    assert content["report"].startswith("report/")
    assert Recipe.from_json(Recipe("a", "report").to_json()).kind == "report"


def test_rates_under_shifts_are_told_beside_the_usual_ones(store):
    shifts = {"slippery": {"kind": "friction"}, "dim": {"kind": "light"}}
    config = StudyConfig(name="study", conditions=("bc",), seeds=(0,), shifts=shifts)
    noting = Noting()
    outcome = execute(Session(store, performer=Stub(store)), config, Tracking(noting, config))
    content = outcome.to_json(store)
    (model,), (row,) = content["models"], content["table"]
    assert model["shifted"]["slippery"].startswith("evaluation/")
    assert model["shifted"]["slippery"] != model["evaluation"]
    assert model["shifted"]["dim"] is row["shifted"]["dim"] is None
    assert row["shifted"]["slippery"] == {"average": 1.0, "interval": row["interval"]}
    assert row["episodes"] == 4
    noted = noting.noted["BC, seed 0"]
    assert noted.shifted == {"slippery": model["shifted"]["slippery"]}
    assert noted.unnoticed == ("dim",)
    told = _facts(config, outcome, store)["Shifts"]
    assert told.startswith("slippery: with other friction (factor 0.3); dim: under another light (turn_rad 0.6")


def test_a_model_for_several_tasks_does_without_the_successes_of_one(store, tmp_path):
    path = tmp_path / "tasks.yaml"
    path.write_text("flow: study\nconditions: [multitask]\nseeds: [0]\ntasks: [one_leg, lamp]\n")
    study, _ = load_runs(path)
    stub = Stub(store, failing={"select"})
    (model,) = run_models(Session(store, performer=stub), study)
    assert model.evaluation is not None
    assert "none of 4" in model.finding


@pytest.mark.parametrize("name", ["smoke.yaml", "table_vi.yaml", "paper.yaml", "study_one_leg.yaml", "demo.yaml"])
def test_a_report_holds_the_configuration_that_makes_it_again(store, tmp_path, name):
    for config in load_runs(Path(__file__).parents[3] / "configs" / name):
        performed = []
        stub = Stub(store)

        def perform(call, session, stub=stub, performed=performed):
            performed.append(call)
            return stub(call, session)

        models = tuple(run_models(Session(store, performer=Stub(store)), config, parallel=False))
        execution.write_report(Session(store, performer=perform), config, RunOutcome(models, None))
        (call,) = performed
        path = tmp_path / "again.yaml"
        path.write_text(configuration_text(call.recipe.config["configuration"]))
        assert load_runs(path) == (config,)


@pytest.mark.parametrize(
    ("uri", "expected"),
    [
        ("https://user:secret@mlflow.example.org:5000/base/", "https://mlflow.example.org:5000/base/#/experiments"),
        ("http://127.0.0.1:5000", "http://127.0.0.1:5000/#/experiments"),
        ("sqlite:////tmp/mlflow.db", None),
        ("none", None),
        ("http://[", None),
        ("", None),
    ],
)
def test_a_report_links_to_a_tracking_server_without_its_password(monkeypatch, uri, expected):
    monkeypatch.setenv("JUICER_TRACKING_URI", uri)
    assert execution._links() == ({} if expected is None else {"MLflow": expected})
