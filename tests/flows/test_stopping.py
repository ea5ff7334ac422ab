"""Evaluations that end when what is to be known is settled."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

import pytest

from flows.config import CollectInferConfig, StudyConfig
from flows.loop import evaluate_further, run_model
from flows.running.context import RunContext, expect
from flows.running.execution import RunOutcome, execute, run_models
from flows.running.plan import evaluated_models, is_complete, plan
from flows.running.tracking import Tracking
from flows.runs import parse_runs
from flows.stopping import StopConfig, episodes_in_words, open_conditions
from flows.terminal.progress import Board
from juicer.artifacts.manifest import FINDING
from juicer.artifacts.store import ArtifactStore
from juicer.artifacts.workspace import delete_tree
from juicer.episode import Outcome
from juicer.errors import ConfigError, TrainingFailed
from juicer.evaluation import ConditionResult, ModelResult, summarise
from juicer.reporting.setting import Setting
from juicer.reporting.sources import Sources
from juicer.storage.evaluations import EvaluationRow, write_evaluation
from juicer.study.material import Measured, TaskStudy
from juicer.study.statistics import differences
from stages.evaluate import facts
from stages.runtime.session import Session

STUDY = StudyConfig(
    name="study", conditions=("bc", "ta", "ci"), seeds=(0, 1), evaluate={"episodes": 40, "stop": {"every": 12}}
)
PATTERNS = {"bc": "10", "ta": "1", "ci": "1100"}
"""By condition, whether the episodes succeed, again and again: TA is better than BC, and CI the same.

The model of the next seed is one episode ahead, for models that fail from the same states tell no more than one does.
"""


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
                    pattern, seed = PATTERNS[condition], int(session.label.split()[2])
                    write_rows(draft, pattern[seed:] + pattern[:seed], call.recipe.config)
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


def study(*results: ConditionResult, **settings: str) -> TaskStudy:
    """Conditions of which some change something, each by its name."""
    changed = {each.condition: Setting(changes=settings.get(each.condition, "")) for each in results}
    measured = {each.condition: Measured(each, changed[each.condition], "states", ()) for each in results}
    return TaskStudy("one_leg", measured, cast(Sources, None))


def episodes(results):
    return {result.condition: [len(model.successes) for model in result.models] for result in results}


def test_a_condition_ends_when_all_its_comparisons_are_decided(store):
    stub = Evaluating(store)
    outcome = execute(Session(store, performer=stub), STUDY, None)
    results = outcome.results(store)
    assert episodes(results) == {"bc": [40, 40], "ta": [12, 12], "ci": [40, 40]}
    assert all(result.anytime for result in results)
    assert sorted(set(stub.made)) == sorted(
        [*((name, n) for name in ("bc", "ci") for n in (12, 24, 36, 40)), ("ta", 12)]
    )
    page = store.recipe(outcome.report).config["facts"]["Evaluation episodes a model"]
    assert page.startswith("at most 40: BC 40 (not settled), TA 12, CI 40 (not settled); looked after every 12")


def test_all_end_when_all_is_settled(store):
    pair = StudyConfig(**{**dict(STUDY), "conditions": ("bc", "ta")})
    models = run_models(Session(store, performer=Evaluating(store)), pair)
    assert episodes(RunOutcome(tuple(models), None).results(store)) == {"bc": [12, 12], "ta": [12, 12]}


def test_what_was_evaluated_is_never_evaluated_again(store):
    first, second = Evaluating(store), Evaluating(store)
    part = STUDY.narrowed(["ta"], [1])
    execute(Session(store, performer=first), part, None)
    execute(Session(store, performer=second), STUDY, None)
    # Alone it is compared with none.
    assert first.made == [("ta", n) for n in (12, 24, 36, 40)]
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


class Expecting(Evaluating):
    """Tells a display of every call, and notes how many evaluations are expected after it."""

    def __init__(self, store: ArtifactStore, board: Board) -> None:
        super().__init__(store)
        self.board, self.left = board, []

    def __call__(self, call, session):
        state = "reused" if self.store.find(call.recipe) else "done"
        ref = super().__call__(call, session)
        session.display.finished(call.stage.name, session.label, str(ref), state, {})
        if call.stage.name == "evaluate":
            self.left.append(evaluations_expected(self.board))
        return ref


def evaluations_expected(board):
    return sum(call.stage == "evaluate" for call in board._forecast.expected.values())


def follow(store):
    """Run the study; gives how many evaluations were expected before, after each, and at the end."""
    board = Board()
    performer = Expecting(store, board)
    session = Session(store, performer=performer, display=board)
    expect(RunContext(session, board, None), plan(store, STUDY), Path(store.url).parent)
    before = evaluations_expected(board)
    run_models(session, STUDY, parallel=False)
    return [before, *performer.left, evaluations_expected(board)]


def test_every_block_is_expected_until_its_condition_is_settled(store):
    # Two models of three conditions have four blocks each; those of TA are settled after one.
    assert follow(store) == [24, *range(23, 17, -1), *range(11, -1, -1), 0]


def test_blocks_that_are_reused_leave_expected_what_is_to_come(store):
    run_models(Session(store, performer=Evaluating(store)), STUDY.narrowed(["bc"], [0]))
    assert follow(store)[:4] == [20, 20, 19, 18]


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


class Noting:
    """Recorder that keeps what it is told."""

    def __init__(self):
        self.noted = []

    def note(self, model):
        self.noted.append((model.label, model.evaluation))


def test_the_records_show_the_last_evaluation_only(store):
    noting = Noting()
    outcome = execute(Session(store, performer=Evaluating(store)), STUDY, Tracking(noting, STUDY))
    assert set(noting.noted) == {
        (f"{model.title}, seed {model.seed}", str(model.evaluation)) for model in outcome.models
    }


def test_what_is_settled_is_recorded_also_if_another_fails_later(store):
    class Failing(Evaluating):
        def __call__(self, call, session):
            if session.label.startswith("ci seed 1") and call.recipe.config.get("episodes") == self.fails_at:
                raise TrainingFailed("odd")
            return super().__call__(call, session)

    for Failing.fails_at, settled in ((12, 0), (24, 2)):
        noting = Noting()
        with pytest.raises(TrainingFailed):
            run_models(Session(store, performer=Failing(store)), STUDY, Tracking(noting, STUDY))
        labels = [label for label, _ in noting.noted]
        assert labels[:settled] == ["TA, seed 0", "TA, seed 1"][:settled]
        assert {"BC, seed 0", "BC, seed 1", "TA, seed 0", "TA, seed 1", "CI, seed 0"} <= set(labels)
        assert len(labels) == len(set(labels))


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
    assert open_conditions(study(condition("ta", "1" * 25)), stop) == {"ta": "not settled"}
    assert open_conditions(study(condition("ta", "1" * 25, "1" * 25)), stop) == {}


def test_both_must_be_settled_where_both_are_asked_for():
    bc, ta = condition("bc", "10" * 10), condition("ta", "1" * 20)
    assert open_conditions(study(bc, ta), StopConfig()) == {}
    assert open_conditions(study(bc, ta), StopConfig(width=0.3)) == {"bc": "not settled"}
    assert episodes_in_words(study(bc, ta), StopConfig(width=0.3)) == (
        "bc 20 (not settled), ta 20; looked after every 25 whether all comparisons are decided and the interval is at "
        "most 30 points wide"
    )


def test_an_evaluation_ends_by_the_tests_that_the_report_makes():
    results = [condition(name, "10" * 8) for name in ("replay", "ta", "ci", "ta_ci")]
    results.insert(1, condition("bc", "1" * 16))
    pair, whole = study(*results[:2]), study(*results)
    assert open_conditions(pair, StopConfig()) == {}
    # The same episodes decide less where more pairs are tested together.
    assert set(open_conditions(whole, StopConfig())) == {result.condition for result in results}
    for each in (pair, whole):
        tests = differences([measured.result for measured in each.measured.values()])
        assert all(test.is_significant for test in tests) == (not open_conditions(each, StopConfig()))


def test_what_is_compared_with_none_is_evaluated_to_the_end(store):
    ta, med = condition("ta", "1" * 20), condition("med", "1" * 20)
    alone = study(condition("bc", "10" * 10), ta, med, med="randomness med")
    assert open_conditions(alone, StopConfig()) == {"med": "compared with none"}
    assert open_conditions(alone, StopConfig(width=0.7)) == {}
    told, seeing = replace(condition("bc", "10" * 10), observes="state"), replace(ta, observes="images")
    assert set(open_conditions(study(told, seeing), StopConfig()).values()) == {"compared with none"}
    part = STUDY.narrowed(["ta"], [])
    outcome = execute(Session(store, performer=Evaluating(store)), part, None)
    assert episodes(outcome.results(store)) == {"ta": [40, 40]}
    page = store.recipe(outcome.report).config["facts"]["Evaluation episodes a model"]
    assert page == "at most 40: TA 40 (compared with none); looked after every 12 whether all comparisons are decided"


def test_a_report_follows_the_evaluations_that_there_are(store):
    outcome = execute(Session(store, performer=Evaluating(store)), STUDY, None)
    known, planned = evaluated_models(store, STUDY)
    assert ({model.evaluation for model in known}, planned) == ({model.evaluation for model in outcome.models}, 6)
    (lost,) = (model for model in outcome.models if (model.condition, model.seed) == ("ta", 1))
    delete_tree(store.open(lost.evaluation))
    known, planned = evaluated_models(store, STUDY)
    results = RunOutcome(tuple(known), None).results(store)
    assert (episodes(results), planned) == ({"bc": [40, 40], "ta": [12], "ci": [40, 40]}, 6)
    last = next(model for model in outcome.models if (model.condition, model.seed) == ("ci", 0))
    delete_tree(store.open(last.evaluation))
    known, _ = evaluated_models(store, STUDY)
    results = RunOutcome(tuple(known), None).results(store)
    assert episodes(results)["ci"] == [36, 36]


def test_one_condition_needs_a_width():
    with pytest.raises(ConfigError, match=r"evaluate\.stop settles nothing"):
        parse_runs({"evaluate": {"stop": {}}}, "here")
    unlike = {"flow": "study", "conditions": {"bc": {}, "ta": {"changes": {"randomness": "med"}}}}
    with pytest.raises(ConfigError, match="several conditions that differ in their method alone"):
        parse_runs({**unlike, "evaluate": {"stop": {}}}, "here")
    few = {"changes": {"record": {"demonstrations": 10}}}
    alike = {"flow": "study", "conditions": {"bc": few, "ta": {**few, "setting": "few"}}}
    assert parse_runs({**alike, "evaluate": {"stop": {}}}, "here"), "a name changes nothing"
    (config,) = parse_runs({"evaluate": {"stop": {"width": 0.2}}}, "here")
    assert isinstance(config, CollectInferConfig)
    assert config.evaluation.episodes == 100


def test_one_condition_of_a_study_that_may_stop_is_run_alone_to_the_end():
    """Of a part, nothing is settled by a comparison; what it is compared with later resumes from there."""
    part = STUDY.narrowed(["bc"], [])
    assert StudyConfig.model_validate(part.model_dump(mode="json")) == part


def test_what_a_further_block_finds_replaces_what_the_blocks_before_it_said(tmp_path):
    store = ArtifactStore(tmp_path)

    def perform(call, session):
        said = {
            "collect": "none of 4 succeeded",
            "evaluate": f"{call.recipe.config.get('episodes')} episodes saw other images",
        }
        if call.stage.name in said and call.recipe.config.get("episodes") != 10:
            with store.create(call.recipe) as draft:
                draft.summary |= {FINDING: said[call.stage.name]}
        return call.recipe.ref

    session = Session(store, perform)
    (config,) = parse_runs("base: smoke\nevaluate: {episodes: 30, stop: {every: 10, width: 0.1}}\n", "the run")
    model = run_model(session, config, "ta_ci", 0)
    assert model.findings == ("round 1: none of 4 succeeded",)
    for episodes in (20, 30):
        model = evaluate_further(session, config, model)
        assert model.finding == f"round 1: none of 4 succeeded; {episodes} episodes saw other images"
