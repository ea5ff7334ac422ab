"""Models are found by their names, and whatever is meant by nothing is told with what may have been meant."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactNotFound, ConfigError, WrongArtifactKind
from juicer.library.names import find, read_models


def made(store: ArtifactStore, stage: str, kind: str, config: dict[str, Any], **inputs: Sequence[ArtifactRef]) -> Any:
    recipe = Recipe(stage, kind, config=config, inputs={role: tuple(refs) for role, refs in inputs.items()})
    with store.create(recipe) as draft:
        if not draft.adopted:
            (draft.path / "content").write_text("")
    return draft.ref


def study(store: ArtifactStore, title: str, task: str, rows: Sequence[tuple[str, int]], version: int = 0) -> Any:
    """A report on models that nobody trained; gives their evaluations."""
    evaluations = []
    for condition, seed in rows:
        facts = {"condition": condition, "seed": seed, "task": task, "version": version}
        checkpoint = made(store, "train", "checkpoint", facts)
        evaluations.append(made(store, "evaluate", "evaluation", facts, checkpoint=[checkpoint]))
    named = [{"condition": condition, "seed": seed} for condition, seed in rows]
    made(store, "report", "report", {"title": title, "task": task, "rows": named}, evaluations=evaluations)
    return evaluations


@pytest.fixture
def store(tmp_path: Path) -> ArtifactStore:
    return ArtifactStore(tmp_path)


def test_as_much_of_a_name_will_do_as_tells_the_models_apart(store: ArtifactStore):
    bc, ta_ci, second = study(store, "first study", "one_leg", [("bc", 0), ("ta_ci", 0), ("ta_ci", 1)])
    (lamp,) = study(store, "other", "lamp", [("bc", 0)])
    for text, ref in {
        "first_study/one_leg/bc/seed-0": bc,
        "one_leg/bc": bc,
        "one_leg/TA+CI/Seed 1": second,
        "seed-1": second,
        "First study/ta_ci/seed-0": ta_ci,
        "lamp": lamp,
        "other": lamp,
    }.items():
        assert find(store, text, "evaluation") == ref
        assert find(store, text) == ref
        assert find(store, text, "checkpoint") == store.manifest(ref).recipe.inputs["checkpoint"][0]
    assert find(store, lamp.id[:6], "evaluation") == find(store, str(lamp)) == lamp


def test_of_two_reports_with_one_name_the_newer_counts(store: ArtifactStore):
    study(store, "study", "one_leg", [("bc", 0)])
    (newer,) = study(store, "study", "one_leg", [("bc", 0)], version=1)
    assert [model.evaluation for model in read_models(store)] == [newer]
    assert find(store, "study/bc") == newer


def test_the_name_of_a_model_means_its_evaluation_without_a_shift(store: ArtifactStore):
    usual, shifted = (made(store, "evaluate", "evaluation", {"shift": each}) for each in (None, "push"))
    rows = [{"condition": "bc", "seed": 0, "shift": each} for each in ("", "push")]
    made(store, "report", "report", {"title": "study", "task": "one_leg", "rows": rows}, evaluations=[usual, shifted])
    assert find(store, "study/one_leg/bc/seed-0", "evaluation") == usual
    assert len(read_models(store)) == 1


def test_two_names_of_one_evaluation_are_no_doubt(store: ArtifactStore):
    (mine,) = study(store, "mine", "one_leg", [("bc", 0)])
    assert study(store, "yours", "one_leg", [("bc", 0)]) == [mine]
    assert find(store, "bc") == mine
    with pytest.raises(ArtifactNotFound, match="may be any of mine/one_leg/bc/seed-0, yours/one_leg/bc/seed-0"):
        find(store, "bc", "report")


@pytest.mark.parametrize(
    ("text", "kinds", "error", "problem"),
    [
        ("ta_cl/seed-0", (), ArtifactNotFound, r"no model is called 'ta_cl/seed-0' in .*did you mean 'ta_ci/seed-0'\?"),
        ("xyz", (), ArtifactNotFound, "there are study/one_leg/bc/seed-0, study/one_leg/ta_ci/seed-0"),
        ("seed-0", (), ArtifactNotFound, "'seed-0' may be any of study/one_leg/bc/seed-0, study/one_leg/ta_ci/seed-0"),
        ("seed-0/bc", (), ArtifactNotFound, "no model is called 'seed-0/bc'"),
        ("bc/seed-0", ("episodes",), WrongArtifactKind, "is a model, which has an evaluation and a checkpoint"),
        ("ffff", (), ArtifactNotFound, "no artifact answers to 'ffff'"),
        ("episodes/ffff", (), ArtifactNotFound, "no artifact answers to 'episodes/ffff'"),
        ("", (), ArtifactNotFound, "no artifact answers to ''"),
        (7, (), ConfigError, "named by a text, its id or a model's name, not by 7"),
        ("bc", ("episode",), ConfigError, "unknown kind of artifact 'episode'; did you mean 'episodes'"),
    ],
)
def test_what_means_nothing_is_told_with_what_may_be_meant(
    store: ArtifactStore, text: Any, kinds: tuple[str, ...], error: type[Exception], problem: str
):
    study(store, "study", "one_leg", [("bc", 0), ("ta_ci", 0)])
    with pytest.raises(error, match=problem):
        find(store, text, *kinds)


def test_an_artifact_of_another_kind_is_refused(store: ArtifactStore):
    ref = made(store, "annotate", "annotations", {})
    with pytest.raises(WrongArtifactKind, match="is of kind 'annotations' but 'episodes or evaluation' is needed"):
        find(store, ref.id, "episodes", "evaluation")


@pytest.mark.parametrize(
    "rows", [None, {}, [1], [{"condition": 3, "seed": 0}], [{"condition": "bc"}], [{"condition": "bc", "seed": 0}] * 2]
)
def test_a_report_that_names_no_models_does_no_harm(store: ArtifactStore, rows: Any):
    evaluation = made(store, "evaluate", "evaluation", {})
    made(store, "report", "report", {"title": "odd", "rows": rows}, evaluations=[evaluation])
    assert read_models(store) == []


def test_a_model_whose_evaluation_was_deleted_has_no_checkpoint(store: ArtifactStore):
    (evaluation,) = study(store, "study", "one_leg", [("bc", 0)])
    store.set_aside(evaluation)
    (model,) = read_models(store)
    assert model.checkpoint is None
    with pytest.raises(WrongArtifactKind):
        find(store, "bc", "checkpoint")


def test_what_is_known_of_a_model_is_forgotten_with_its_evaluation(store: ArtifactStore):
    (evaluation,) = study(store, "study", "one_leg", [("bc", 0)])
    assert find(store, "bc", "checkpoint").kind == "checkpoint"
    store.set_aside(evaluation)
    assert [model.checkpoint for model in read_models(store)] == [None]
