"""What MLflow is told of a model beside its artifacts."""

from __future__ import annotations

from flows.config import StudyConfig
from flows.loop import ModelOutcome, run_model
from flows.running.tracking import Tracking
from flows.runs import parse_runs
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.expert.human import Human
from stages.augment import AugmentConfig
from stages.record import RecordSection
from stages.runtime.context import NoRecord
from stages.runtime.session import Session


class Noting:
    """Recorder that keeps the last model it is told of."""

    def note(self, model):
        self.model = model


def identity(conditions, **config):
    """Of the first condition."""
    noting, name = Noting(), next(iter(conditions))
    config = StudyConfig(name="study", conditions=conditions, seeds=(0,), **config)
    outcome = ModelOutcome(name, "BC", 0, ArtifactRef("checkpoint", "0" * 16), ArtifactRef("evaluation", "1" * 16))
    Tracking(noting, config).finish(outcome)
    return noting.model.identity


class Turn:
    """Record of nothing, which knows after how many turns of collect, select, train it is one."""

    def __init__(self, turn=0):
        self.turn = turn

    def for_round(self, turn):
        return Turn(turn)


def test_the_curves_of_a_model_for_several_tasks_are_those_of_its_last_training(tmp_path):
    (run, _) = parse_runs({"base": "laptop", "tasks": ["one_leg", "lamp"], "condition": "multitask"}, "here")
    records = []

    def perform(call, session):
        if call.stage.name == "train":
            records.append(session.record)
        return call.recipe.ref

    run_model(Session(ArtifactStore(tmp_path), performer=perform, record=Turn()), run, "multitask", 0)
    *gathered, final = records
    assert {type(record) for record in gathered} == {NoRecord}
    assert (len(gathered), final.turn) == (2, 1)


def test_code_that_only_tells_of_models_makes_them_no_others(monkeypatch):
    before = identity({"bc": {}})
    changed = "report"
    monkeypatch.setattr("flows.running.tracking.code_version", lambda name: f"{name} {name == f'stages.{changed}'}")
    monkeypatch.setattr("flows.running.tracking.STAGES", ("report", "train"))
    told = identity({"bc": {}})
    changed = ""
    assert identity({"bc": {}}) == told
    changed = "train"
    assert identity({"bc": {}}) != told != before


def test_what_a_condition_changes_makes_it_another_model_only_if_its_training_or_measurement_differs():
    usual = identity({"bc": {}})
    push = {"push": {"kind": "push"}}
    sampling = {"samples": {"kind": "sampling"}}
    for changes in ({"shifts": push}, {"analyses": sampling}):
        assert identity({"bc": {"changes": changes}}) == identity({"bc": {}}, **changes) == usual
    few = {"record": {"demonstrations": 10}}
    assert identity({"bc": {"changes": few}}) == identity({"bc": {}}, **few) != usual


def test_other_tasks_count_for_models_that_learn_them_alone():
    def of(task_of_lamp):
        content = {"name": "study", "flow": "study", "conditions": ["bc", "multitask"], "seeds": [0]}
        one_leg, _ = parse_runs({**content, "tasks": {"one_leg": {}, "lamp": task_of_lamp}}, "here")
        tracking = Tracking(Noting(), one_leg)
        return [tracking._describe(name, 0).identity for name in ("bc", "multitask")]

    bc, multitask = of({})
    assert of({"augment": {"num_snippets": 7}})[0] == bc
    assert of({"augment": {"num_snippets": 7}})[1] != multitask
    assert of({"shifts": {"push": {"kind": "push"}}}) == [bc, multitask]


def test_all_that_shapes_a_round_is_among_the_parameters():
    config = StudyConfig(
        name="study",
        conditions=("ta_ci",),
        seeds=(0,),
        rounds=3,
        record=RecordSection(temperament=Human()),
        augment_retraining=AugmentConfig(num_snippets=7),
    )
    noting = Noting()
    evaluation = ArtifactRef("evaluation", "1" * 16)
    Tracking(noting, config).finish(ModelOutcome("ta_ci", "TA+CI", 0, ArtifactRef("checkpoint", "0" * 16), evaluation))
    params = noting.model.params
    assert (params["rounds"], params["augment_retraining.num_snippets"]) == (3, 7)
    assert (params["correct.corrections"], params["correct.temperament.kind"]) == (10, "human")
