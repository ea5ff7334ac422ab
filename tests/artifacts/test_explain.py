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
            Difference("inputs", "episodes", "changed", [str(FIRST)], [str(FIRST), str(SECOND)]),
            f"input 'episodes' is {FIRST}, {SECOND}, it was {FIRST}",
        ),
        (
            {"config": {"steps": 20, "policy": {"width": 512, "name": "mlp"}, "extra": None}},
            Difference("config", "steps", "changed", 10, 20),
            "config key 'steps' is 20, it was 10",
        ),
        (
            {"config": {"steps": 10, "policy": {"width": 512, "name": "unet"}, "extra": None}},
            Difference("config", "policy.name", "changed", "mlp", "unet"),
            "config key 'policy.name' is unet, it was mlp",
        ),
        (
            {"config": {"steps": 10, "policy": {"width": 512, "name": "mlp"}}},
            Difference("config", "extra", "removed", None, None),
            "config key 'extra' is gone, it was null",
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
            "code of 'juicer.geometry' is gone",
        ),
        (
            {"code": "new"},
            Difference("code", "train", "changed", "old", "new"),
            "code of 'train' changed",
        ),
        (
            {"files": {"labels.csv": "bb"}},
            Difference("files", "labels.csv", "changed", "aa", "bb"),
            "file 'labels.csv' changed",
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
    assert difference in explanation.differences
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
    assert len(explanation.differences) == 1
