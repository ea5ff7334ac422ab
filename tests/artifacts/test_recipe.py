"""Recipes: what makes an id, and what does not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef

FIRST, SECOND = ArtifactRef("episodes", "1" * 16), ArtifactRef("episodes", "2" * 16)


@pytest.mark.parametrize(
    "change",
    [
        {"stage": "augment"},
        {"kind": "selection"},
        {"inputs": {"episodes": (FIRST,)}},
        {"config": {"seed": 4, "limits": {"low": 0.5}}},
        {"config": {"seed": 3, "limits": {"low": 0.5}, "more": None}},
        {"code": "0ther"},
        {"files": {"log": "cd" * 32}},
        {"libraries": {"numpy": "2.4.7"}},
        {"tasks": {"lamp": {"max_steps": 1}}},
    ],
)
def test_every_part_of_a_recipe_changes_its_id(recipe: Recipe, change: dict[str, object]) -> None:
    assert replace(recipe, **change).id != recipe.id


def test_the_order_of_keys_does_not_change_the_id(recipe: Recipe) -> None:
    assert replace(recipe, config={"limits": {"low": 0.5}, "seed": 3}).id == recipe.id


def test_the_order_of_inputs_within_a_role_changes_the_id(recipe: Recipe) -> None:
    forward = replace(recipe, inputs={"episodes": (FIRST, SECOND)})
    assert replace(recipe, inputs={"episodes": (SECOND, FIRST)}).id != forward.id


def test_a_role_without_inputs_does_not_change_the_id(recipe: Recipe) -> None:
    assert replace(recipe, inputs={"selections": ()}).id == recipe.id


def test_module_versions_and_plugins_explain_but_do_not_identify(recipe: Recipe) -> None:
    assert replace(recipe, modules={"juicer.geometry": "f00"}, plugins=("lab.head",)).id == recipe.id


def test_an_id_never_changes_by_accident() -> None:
    # Every artifact in every store would be lost to its recipe.
    recipe = Recipe(
        "train", "checkpoint", {"episodes": (FIRST,)}, {"steps": 10, "rate": 1e-4}, "c", {"f": "0"}, {"l": "1"}
    )
    assert recipe.id == "ebafa7d7a1cc51b3"


def test_a_recipe_reads_back_from_its_json(recipe: Recipe) -> None:
    full = replace(recipe, inputs={"a": (FIRST, SECOND)}, config={"x": (1, 2)}, modules={"juicer.geometry": "f00"})
    full = replace(full, plugins=("lab.head",), tasks={"lamp": {"parts": (1, 2.5)}})
    assert Recipe.from_json(full.to_json()) == full
    assert Recipe.from_json(full.to_json()).modules == full.modules
    assert Recipe.from_json(full.to_json()).plugins == full.plugins


def test_parents_are_named_once(recipe: Recipe) -> None:
    assert replace(recipe, inputs={"a": (SECOND, FIRST), "b": (FIRST,)}).parents == (SECOND, FIRST)


def test_a_config_without_a_canonical_form_is_refused() -> None:
    with pytest.raises(ValueError, match="JSON"):
        Recipe("train", "checkpoint", config={"rate": float("nan")})


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="did you mean 'episodes'"):
        Recipe("ingest", "episode")
