"""Explanations of hits and misses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from juicer.artifacts.explain import Difference, explain
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore

Make = Callable[..., ArtifactRef]

FIRST, SECOND = ArtifactRef("episodes", "1" * 16), ArtifactRef("episodes", "2" * 16)


@pytest.fixture
def recipe() -> Recipe:
    return Recipe(
        stage="train",
        kind="checkpoint",
        inputs={"episodes": (FIRST,)},
        config={"steps": 10, "policy": {"width": 512, "name": "mlp"}, "extra": None},
        code="old",
        files={"labels.csv": "aa"},
        libraries={"torch": "2.13.0"},
        modules={"juicer.seeding": "1", "juicer.geometry": "1"},
    )


def test_a_hit_is_explained_as_reuse(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    make(store, recipe)
    explanation = explain(store, recipe)
    assert explanation.hit
    assert explanation.sentences == [f"{recipe.ref} exists and would be reused"]


def test_a_stage_that_never_ran_is_explained_as_such(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    make(store, replace(recipe, stage="distill"))
    explanation = explain(store, recipe)
    assert (explanation.hit, explanation.nearest) == (False, None)
    assert "has made no artifact before" in explanation.sentences[0]


@pytest.mark.parametrize(
    ("change", "difference", "sentence"),
    [
        (
            {"inputs": {"episodes": (FIRST, SECOND)}},
            Difference("inputs", "episodes", "added", None, str(SECOND)),
            f"input 'train.episodes' is new: {SECOND}",
        ),
        (
            {"config": {"steps": 20, "policy": {"width": 512, "name": "mlp"}, "extra": None}},
            Difference("config", "steps", "changed", 10, 20),
            "config key 'train.steps' is 20, it was 10",
        ),
        (
            {"config": {"steps": 10, "policy": {"width": 512, "name": "unet"}, "extra": None}},
            Difference("config", "policy.name", "changed", "mlp", "unet"),
            "config key 'train.policy.name' is unet, it was mlp",
        ),
        (
            {"config": {"steps": 10, "policy": {"width": 512, "name": "mlp"}}},
            Difference("config", "extra", "removed", None, None),
            "config key 'train.extra' is gone, it was null",
        ),
        (
            {"config": {"steps": 10, "policy": {"width": 512, "name": "mlp"}, "extra": {"grasp": {"shift_m": 0.01}}}},
            Difference("config", "extra", "changed", None, {"grasp": {"shift_m": 0.01}}),
            'config key \'train.extra\' is {"grasp": {"shift_m": 0.01}}, it was null',
        ),
        (
            {"code": "new", "modules": {"juicer.seeding": "1", "juicer.geometry": "2"}},
            Difference("code", "juicer.geometry", "changed", "1", "2"),
            "code of 'juicer.geometry' changed",
        ),
        (
            {"code": "new", "modules": {"juicer.seeding": "1", "juicer.geometry": "1", "juicer.config": "1"}},
            Difference("code", "juicer.config", "added", None, "1"),
            "code of 'juicer.config' is new",
        ),
        (
            {"code": "new", "modules": {}},
            Difference("code", "juicer.geometry", "removed", "1", None),
            "code of 'juicer.geometry', 'juicer.seeding' is gone",
        ),
        (
            {"code": "new"},
            Difference("code", "train", "changed", "old", "new"),
            "code of 'train' changed",
        ),
        (
            {"files": {"labels.csv": "bb"}},
            Difference("files", "labels.csv", "changed", "aa", "bb"),
            "file 'train.labels.csv' changed",
        ),
        (
            {"libraries": {"torch": "2.14.0"}},
            Difference("libraries", "torch", "changed", "2.13.0", "2.14.0"),
            "library 'torch' is 2.14.0, it was 2.13.0",
        ),
    ],
)
def test_a_miss_is_explained_by_what_differs(
    store: ArtifactStore, recipe: Recipe, make: Make, change: dict[str, object], difference: Difference, sentence: str
) -> None:
    ref = make(store, recipe)
    explanation = explain(store, replace(recipe, **change))
    assert explanation.nearest is not None
    assert explanation.nearest.ref == ref
    assert difference in [cause.difference for cause in explanation.causes]
    assert sentence in explanation.sentences
    assert f"the nearest is {ref}" in explanation.sentences[0]


def test_the_nearest_has_the_fewest_differences_and_among_equals_is_the_newest(
    store: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    make(store, replace(recipe, config={"steps": 1, "rate": 2}))
    make(store, replace(recipe, config={"steps": 1, "rate": 0}))
    newest = make(store, replace(recipe, config={"steps": 0, "rate": 0}))
    make(store, replace(recipe, config={"steps": 1, "rate": 1}, code="older"))
    explanation = explain(store, replace(recipe, config={"steps": 0, "rate": 2}))
    assert explanation.nearest is not None
    assert explanation.nearest.ref == newest
    assert len(explanation.causes) == 1


def chain(demonstrations: int = 50, steps: int = 10, code: str = "old") -> list[Recipe]:
    """Recipes of record, ingest, train and evaluate, each made from the one before it."""
    modules = {"juicer.sim": code}
    recorded = Recipe("record", "logs", config={"demonstrations": demonstrations}, code=code, modules=modules)
    ingested = Recipe("ingest", "episodes", inputs={"logs": (recorded.ref,)})
    trained = Recipe("train", "checkpoint", inputs={"episodes": (ingested.ref,)}, config={"steps": steps})
    evaluated = Recipe("evaluate", "evaluation", inputs={"checkpoint": (trained.ref,)}, code=code, modules=modules)
    return [recorded, ingested, trained, evaluated]


def test_a_changed_key_far_upstream_is_named_once_with_what_follows(store: ArtifactStore, make: Make) -> None:
    for recipe in chain():
        make(store, recipe)
    planned = chain(demonstrations=40)
    explanation = explain(store, planned[-1], planned)
    assert explanation.reasons == [
        "config key 'record.demonstrations' is 40, it was 50, so ingest, train and evaluate are computed again"
    ]


def test_changed_code_is_named_by_module_with_every_stage_that_it_concerns(store: ArtifactStore, make: Make) -> None:
    for recipe in chain():
        make(store, recipe)
    planned = chain(code="new", steps=20)
    assert explain(store, planned[-1], planned).reasons == [
        "config key 'train.steps' is 20, it was 10, so evaluate is computed again",
        "code of 'juicer.sim' changed, so record, ingest, train and evaluate are computed again",
    ]
    assert explain(store, planned[0], planned).reasons == ["code of 'juicer.sim' changed"]


def test_an_artifact_of_another_lineage_is_not_the_nearest_however_few_the_differences(
    store: ArtifactStore, make: Make
) -> None:
    *plain, plain_evaluation = chain()
    for recipe in (*plain, plain_evaluation):
        make(store, recipe)
    selected = Recipe("select", "selection", inputs={"episodes": (plain[1].ref,)})
    retrained = replace(plain[2], inputs={**plain[2].inputs, "selections": (selected.ref,)})
    evaluated = replace(plain_evaluation, inputs={"checkpoint": (retrained.ref,)})
    for recipe in (selected, retrained, evaluated):
        make(store, recipe)
    planned = chain(demonstrations=40, steps=20)
    explanation = explain(store, planned[-1], planned)
    assert explanation.nearest is not None
    assert explanation.nearest.ref == plain_evaluation.ref
    assert len(explanation.causes) == 2


def test_an_ancestor_that_is_gone_is_told_as_it_is(store: ArtifactStore, make: Make) -> None:
    *upstream, trained, evaluated = chain()
    for recipe in (*upstream, trained, evaluated):
        make(store, recipe)
    store.set_aside(upstream[1].ref)
    planned = chain(demonstrations=40)
    (reason,) = explain(store, planned[-1], planned).reasons
    assert reason == (
        f"input 'train.episodes' is {planned[1].ref}, it was {upstream[1].ref}, so evaluate is computed again"
    )


def test_of_equal_candidates_that_of_the_same_task_is_the_nearest(store: ArtifactStore, make: Make) -> None:
    recipe = Recipe("collect", "episodes", config={"task": "lamp", "first": 0, "a": 1, "b": 1, "c": 1})
    own = make(store, recipe)
    make(store, replace(recipe, config={**recipe.config, "task": "one_leg", "a": 2, "b": 2, "c": 2}))
    explanation = explain(store, replace(recipe, config={**recipe.config, "a": 2, "b": 2, "c": 2}))
    assert explanation.nearest is not None
    assert explanation.nearest.ref == own


def _lamp(radius: float, mass: float = 0.04) -> dict[str, object]:
    thread = {"bead_radius": radius}
    return {"lamp": {"parts": [{"name": "base", "mass": 1.0}, {"name": "bulb", "mass": mass, "threads": [thread]}]}}


def test_an_entry_of_a_task_is_named_with_its_values(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    make(store, replace(recipe, tasks=_lamp(0.011)))
    explanation = explain(store, replace(recipe, tasks=_lamp(0.012)))
    assert explanation.reasons == ["task lamp: parts.bulb.threads.0.bead_radius is 0.012, it was 0.011"]


def test_a_change_of_a_task_is_told_once_with_what_follows(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    def both(tasks: dict[str, object]) -> tuple[Recipe, Recipe]:
        data = Recipe("ingest", "episodes", tasks=tasks)
        return data, replace(recipe, inputs={"episodes": (data.ref,)}, tasks=tasks)

    for made in both(_lamp(0.011)):
        make(store, made)
    data, training = both(_lamp(0.012))
    (reason,) = explain(store, training, [data]).reasons
    assert reason == (
        "task lamp: parts.bulb.threads.0.bead_radius is 0.012, it was 0.011, so ingest and train are computed again"
    )
