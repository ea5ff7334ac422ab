"""A plan knows every id before anything runs, and that conditions share what they have in common."""

from __future__ import annotations

from collections import Counter

import pytest

from flows.config import CollectInferConfig, StudyConfig
from flows.running.plan import calls_of, is_complete, missing_inputs, plan, ready_calls
from flows.runs import load_runs, parse_runs
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ConfigError


@pytest.fixture
def store(tmp_path):
    return ArtifactStore(tmp_path)


def by_label(planned, stage):
    return {entry.label: entry.ref for entry in planned if entry.stage == stage}


def test_conditions_share_all_that_they_have_in_common(store):
    planned = plan(store, StudyConfig(seeds=(0, 1)))
    counts = Counter(entry.stage for entry in planned)
    assert (counts["record"], counts["ingest"], counts["annotate"], counts["augment"]) == (1, 1, 1, 1)
    # Two of the seven conditions begin as BC and as TA, and train once more; replay has no seeds.
    assert (counts["train"], counts["collect"], counts["select"]) == (14, 4, 4)
    assert (counts["memorise"], counts["evaluate"]) == (1, 15)


SHIFTS = {"shoved": {"kind": "push"}, "slippery": {"kind": "friction"}, "dim": {"kind": "light"}}


def test_every_model_is_evaluated_under_each_shift_that_it_can_notice_from_the_same_states(store):
    planned = plan(store, StudyConfig(conditions=("replay", "bc"), seeds=(0,), shifts=SHIFTS))
    evaluations = {entry.label: entry.call.recipe for entry in calls_of(planned, "evaluate")}
    names = ("", " under shoved", " under slippery")
    assert set(evaluations) == {f"{condition} seed 0{name}" for condition in ("replay", "bc") for name in names}
    usual, shoved = (evaluations[f"bc seed 0{name}"] for name in names[:2])
    assert shoved.inputs == usual.inputs
    assert {**shoved.config, "shift": None} == usual.config
    assert shoved.config["shift"]["kind"] == "push"


def test_policies_that_see_images_are_evaluated_under_another_light(store):
    (config,) = load_runs("robustness", ["base=laptop_image", "conditions=[replay, bc]"])
    labels = {entry.label for entry in calls_of(plan(store, config), "evaluate")}
    assert {"bc seed 0 under light", "bc seed 0 under camera"} <= labels
    assert "replay seed 0 under light" not in labels


def test_a_shift_changes_nothing_of_what_was_there_before(store):
    config = StudyConfig(conditions=("ta_ci",), seeds=(0,))
    usual = {entry.ref for entry in plan(store, config)}
    shifted = {entry.ref for entry in plan(store, StudyConfig(**{**dict(config), "shifts": SHIFTS}))}
    assert usual < shifted
    assert len(shifted - usual) == 2


def test_collecting_begins_with_the_model_of_the_plain_condition(store):
    planned = plan(store, StudyConfig(conditions=("ta", "ta_ci"), seeds=(0,)))
    trained = by_label(planned, "train")
    (collected,) = calls_of(planned, "collect")
    assert collected.call.recipe.parents == (trained["ta seed 0"],)
    assert set(trained) == {"ta seed 0", "ta_ci seed 0 round 1"}


def test_retraining_goes_on_from_the_model_before_if_it_is_asked_to(store):
    content = {
        "flow": "study",
        "seeds": [0],
        "conditions": {"further": {"collect": True, "rounds": 2, "retraining_steps": 50}},
    }
    (config,) = parse_runs(content, "here")
    first, second, third = (entry.call.recipe for entry in calls_of(plan(store, config), "train"))
    assert "start" not in first.inputs
    assert [recipe.inputs["start"] for recipe in (second, third)] == [(first.ref,), (second.ref,)]
    assert [recipe.config["training"]["steps"] for recipe in (second, third)] == [50, 50]
    assert second.config["training"]["warmup_steps"] == 5
    with pytest.raises(ConfigError, match="retraining_steps are those of a condition that collects"):
        parse_runs({**content, "conditions": {"bc": {"retraining_steps": 50}}}, "here")


def test_retraining_is_training_with_more_references(store):
    planned = plan(store, CollectInferConfig(condition="ci", rounds=2))
    first, second, third = calls_of(planned, "dataset")
    assert first.call.recipe.inputs.keys() == {"episodes"}
    assert [len(call.call.recipe.inputs["selections"]) for call in (second, third)] == [1, 2]
    # The rollouts that a selection is of are named, too.
    assert [len(call.call.recipe.inputs["episodes"]) for call in (first, second, third)] == [1, 2, 3]
    trained = calls_of(planned, "train")
    assert [call.call.recipe.inputs for call in trained] == [
        {"dataset": (each.ref,)} for each in (first, second, third)
    ]
    assert trained[1].call.recipe.config == trained[0].call.recipe.config


def test_corrections_are_of_each_rounds_own_rollouts_and_are_all_learned_from(store):
    own = {"title": "TA+CI+DAgger", "augment": True, "collect": True, "correct": True}
    config = CollectInferConfig(condition="dagger", conditions={"dagger": own}, rounds=2)
    planned = plan(store, config)
    collected, corrected = ([call.ref for call in calls_of(planned, stage)] for stage in ("collect", "correct"))
    parents = [call.call.recipe.parents for call in calls_of(planned, "correct")]
    assert parents == [(ref,) for ref in collected]
    *_, last = calls_of(planned, "dataset")
    assert set(corrected) < set(last.call.recipe.inputs["episodes"])
    assert len(last.call.recipe.inputs["selections"]) == 2


def test_only_a_placement_by_coverage_looks_at_rollouts(store):
    uniform, coverage = (
        calls_of(plan(store, CollectInferConfig(rounds=2, augment={"placement": {"kind": kind}})), "augment")
        for kind in ("uniform", "coverage")
    )
    assert len(uniform) == 1
    assert [len(call.call.recipe.inputs.get("rollouts", ())) for call in coverage] == [0, 1, 2]


def test_augmentation_of_retraining_can_differ(store):
    config = CollectInferConfig(augment={"num_snippets": 50}, augment_retraining={"num_snippets": 150})
    planned = plan(store, config)
    assert [entry.call.recipe.config["num_snippets"] for entry in calls_of(planned, "augment")] == [50, 150]


def test_plan_is_the_same_whatever_the_machine_does_beside(store):
    config = StudyConfig(conditions=("bc",), seeds=(0,))
    assert [entry.ref for entry in plan(store, config)] == [entry.ref for entry in plan(store, config)]
    assert store.refs() == []
    assert not is_complete(store, config)


def test_missing_inputs_are_named_by_the_stage_that_makes_them(store):
    planned = plan(store, CollectInferConfig(condition="ta"))
    (dataset,), (training,) = calls_of(planned, "dataset"), calls_of(planned, "train")
    assert missing_inputs(dataset, planned) == ["augment", "ingest"]
    assert missing_inputs(training, planned) == ["dataset"]


def test_a_stage_makes_what_it_can_and_names_what_can_be_made_at_once(store):
    config = CollectInferConfig(condition="ta_ci")
    planned = plan(store, config)
    made = []
    for stage in ("train", "collect", "augment", "ingest"):
        with pytest.raises(ConfigError, match=r"or `juicer stage record` first"):
            ready_calls(store, [config], stage)
    for stage in ("record", "ingest", "annotate", "augment", "dataset", "train", "collect", "select", "dataset"):
        for entry in ready_calls(store, [config], stage):
            made.append(entry.label)
            if not store.find(entry.call.recipe):
                with store.create(entry.call.recipe):
                    pass
    assert made[4:6] == ["ta_ci seed 0", "ta_ci seed 0"], "the first round's dataset and training alone"
    assert [entry.exists for entry in calls_of(plan(store, config), "dataset")] == [True, True]
    assert len(calls_of(planned, "train")) == 2


def test_stage_that_a_run_does_not_have_is_named(store):
    planned = plan(store, CollectInferConfig(condition="bc"))
    with pytest.raises(ConfigError, match="this configuration has no stage 'collect'"):
        calls_of(planned, "collect")


def test_logs_of_a_human_take_the_place_of_the_scripted_operator(store, tmp_path):
    folder = tmp_path / "logs"
    folder.mkdir()
    with pytest.raises(ConfigError, match="holds no operator log"):
        plan(store, CollectInferConfig(logs=folder))
    (folder / "a.npz").write_bytes(b"log")
    planned = plan(store, CollectInferConfig(logs=folder, condition="bc"))
    assert [entry.stage for entry in planned] == ["ingest", "dataset", "train", "evaluate"]
    assert list(planned[0].call.recipe.files) == ["files/a.npz"]


@pytest.fixture
def mixed(tmp_path):
    """A study of one_leg and one of lamp, each with a model for both."""
    path = tmp_path / "tasks.yaml"
    lamp = "{policies: {diffusion: {training: {steps: 16000}}}}"
    path.write_text(
        f"flow: study\nconditions: [ta_ci, multitask]\nseeds: [0]\ntasks: {{one_leg: {{}}, lamp: {lamp}}}\n"
    )
    return load_runs(path)


def test_a_model_for_several_tasks_learns_what_each_tasks_own_model_learns(store, mixed):
    plans = [plan(store, config) for config in mixed]
    shared = {by_label(planned, "train")["multitask seed 0"] for planned in plans}
    assert len(shared) == 1
    calls = [{entry.label: entry.call for entry in calls_of(planned, "dataset")} for planned in plans]
    own = [call["ta_ci seed 0 round 1"].recipe.inputs for call in calls]
    both = calls[0]["multitask seed 0"].recipe.inputs
    assert both["selections"] == own[0]["selections"] + own[1]["selections"]
    assert sorted(both["episodes"]) == sorted(own[0]["episodes"] + own[1]["episodes"])


def test_a_model_for_several_tasks_is_evaluated_on_each(store, mixed):
    evaluated = [by_label(plan(store, config), "evaluate")["multitask seed 0"] for config in mixed]
    assert len(set(evaluated)) == 2
