"""Evaluations that end when what is to be known is settled."""

from __future__ import annotations

import pytest

from flows.config import CollectInferConfig, StudyConfig
from flows.running.execution import RunOutcome, execute, run_models
from flows.running.plan import is_complete, plan
from flows.running.tracking import Tracking
from flows.runs import parse_runs
from flows.stopping import StopConfig, is_settled, told, unsettled
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Outcome
from juicer.errors import ConfigError
from juicer.evaluation import ConditionResult, ModelResult, summarise
from juicer.storage.evaluations import EvaluationRow, write_evaluation
from stages.evaluate import facts
from stages.runtime.session import Session

STUDY = StudyConfig(
    name="study", conditions=("bc", "ta", "ci"), seeds=(0, 1), evaluate={"episodes": 40, "stop": {"every": 12}}
)
PATTERNS = {"bc": "10", "ta": "1", "ci": "1010101101"}
"""By condition, whether the episodes succeed, again and again: TA is better than BC, CI next to the same."""


class Evaluating:
    """Performs every stage in thought but those that evaluate, whose episodes end as they are told."""

    def __init__(self, store: ArtifactStore) -> None:
        self.store, self.made = store, []

    def __call__(self, call, session):
        if call.stage.name in ("evaluate", "report") and not self.store.find(call.recipe):
            with self.store.create(call.recipe) as draft:
                if call.stage.name == "evaluate":
                    condition = session.label.split()[0]
                    self.made.append((condition, call.recipe.config["episodes"]))
                    write_rows(draft, PATTERNS[condition], call.recipe.config)
        return call.recipe.ref


def write_rows(draft, pattern, config):
    ends = [Outcome.SUCCESS if letter == "1" else Outcome.TIMEOUT for letter in pattern]
    rows = [EvaluationRow(n, 3_000_000 + n, ends[n % len(ends)], 1, 9) for n in range(config["episodes"])]
    write_evaluation(draft.path, rows)
    draft.summary |= facts(rows, ("screwed",), anytime=config["anytime"])


@pytest.fixture
def store(tmp_path):
    return ArtifactStore(tmp_path / "store")


def condition(name: str, *successes: str) -> ConditionResult:
    models = [
        ModelResult(seed, tuple(range(len(each))), tuple(letter == "1" for letter in each))
        for seed, each in enumerate(successes)
    ]
    return summarise(name, models, anytime=True)


def episodes(results):
    return {result.condition: [len(model.successes) for model in result.models] for result in results}


def test_a_condition_ends_when_its_comparison_is_decided_and_the_first_keeps_up_with_the_others(store):
    stub = Evaluating(store)
    outcome = execute(Session(store, performer=stub), STUDY, None)
    results = outcome.results(store)
    assert episodes(results) == {"bc": [40, 40], "ta": [12, 12], "ci": [40, 40]}
    assert all(result.anytime for result in results)
    assert sorted(set(stub.made)) == sorted(
        [*((name, n) for name in ("bc", "ci") for n in (12, 24, 36, 40)), ("ta", 12)]
    )
    page = store.recipe(outcome.report).config["facts"]["Evaluation episodes a model"]
    assert page.startswith("at most 40: BC 40, TA 12, CI 40 (not settled); looked after every 12")


def test_all_end_when_all_is_settled(store):
    study = StudyConfig(**{**dict(STUDY), "conditions": ("bc", "ta")})
    models = run_models(Session(store, performer=Evaluating(store)), study)
    assert episodes(RunOutcome(tuple(models), None).results(store)) == {"bc": [12, 12], "ta": [12, 12]}


def test_what_was_evaluated_is_never_evaluated_again(store):
    first, second = Evaluating(store), Evaluating(store)
    part = STUDY.narrowed(["ta"], [1])
    execute(Session(store, performer=first), part, None)
    execute(Session(store, performer=second), STUDY, None)
    assert first.made == [("ta", 12)]
    assert len(second.made) == 2 * 4 * 2 + 1
    third = Evaluating(store)
    execute(Session(store, performer=third), STUDY, None)
    assert third.made == []
    wider = STUDY.model_copy(update={"evaluate": STUDY.evaluate.model_copy(update={"episodes": 36})})
    run_models(Session(store, performer=third), wider)
    assert third.made == []


def test_a_run_in_thought_counts_on_all_blocks_until_it_knows_better(store):
    def evaluations():
        return sum(entry.stage == "evaluate" for entry in plan(store, STUDY))

    assert evaluations() == 3 * 2 * 4
    execute(Session(store, performer=Evaluating(store)), STUDY, None)
    assert evaluations() == 2 * 2 * 4 + 2


def test_a_stopped_run_is_complete(store):
    def everything(call, session):
        ref = stub(call, session)
        if store.find(call.recipe) is None:
            with store.create(call.recipe):
                pass
        return ref

    stub = Evaluating(store)
    assert not is_complete(store, STUDY)
    execute(Session(store, performer=everything), STUDY, None)
    assert is_complete(store, STUDY)


def test_the_records_show_the_last_evaluation_only(store):
    noted = []

    class Noting:
        def note(self, model):
            noted.append((model.label, model.evaluation))

    outcome = execute(Session(store, performer=Evaluating(store)), STUDY, Tracking(Noting(), STUDY))
    assert set(noted) == {(f"{model.title}, seed {model.seed}", str(model.evaluation)) for model in outcome.models}


def test_an_evaluation_is_the_same_whatever_it_is_to_settle(store):
    wide = STUDY.model_copy(
        update={"evaluate": STUDY.evaluate.model_copy(update={"stop": StopConfig(every=12, width=0.9)})}
    )
    stub = Evaluating(store)
    for study in (STUDY, wide):
        run_models(Session(store, performer=stub), study)
    assert stub.made.count(("ta", 12)) == 2


def test_a_width_is_reached_by_the_episodes_of_all_models():
    stop = StopConfig(width=0.2, comparison=False)
    assert not is_settled(condition("ta", "1" * 25), None, stop)
    assert is_settled(condition("ta", "1" * 25, "1" * 25), None, stop)


def test_both_must_be_settled_where_both_are_asked_for():
    bc, ta = condition("bc", "10" * 10), condition("ta", "1" * 20)
    assert unsettled([bc, ta], StopConfig()) == []
    assert unsettled([bc, ta], StopConfig(width=0.3)) == ["bc"]
    assert unsettled([bc, bc], StopConfig(width=0.8)) == ["bc"]
    assert told([bc, ta], StopConfig(width=0.3)) == (
        "bc 20 (not settled), ta 20; looked after every 25 whether the comparison with bc is decided and the interval "
        "is at most 30 points wide"
    )


def test_one_condition_needs_a_width():
    with pytest.raises(ConfigError, match=r"evaluate\.stop settles nothing"):
        parse_runs({"evaluate": {"stop": {}}}, "here")
    (config,) = parse_runs({"evaluate": {"stop": {"width": 0.2}}}, "here")
    assert isinstance(config, CollectInferConfig)
    assert config.evaluation.episodes == 100
