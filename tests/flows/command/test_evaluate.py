"""``juicer evaluate`` from its command line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from flows.command.cli import call
from flows.command.evaluate import evaluate_checkpoint
from flows.running.repair import Repaired
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Outcome
from juicer.errors import ArtifactError, ConfigError
from juicer.storage.evaluations import EvaluationRow
from juicer.tasks.registry import get_task
from stages.evaluate import facts


def test_where_damage_is_kept_is_told_even_if_the_next_repair_fails(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("JUICER_DATA", str(tmp_path))
    with ArtifactStore(tmp_path).create(Recipe("train", "checkpoint")) as draft:
        pass

    def repair(*arguments: Any) -> Iterator[Repaired]:
        yield Repaired(ArtifactRef("dataset", "0" * 16), True, "/somewhere/.aside/1")
        raise ArtifactError("the disk is full")

    monkeypatch.setattr("flows.command.evaluate.repair", repair)
    assert call(["repair", draft.ref.id]) == 1
    told = capsys.readouterr()
    assert "what was there before is kept in /somewhere/.aside/1" in told.out
    assert "the disk is full" in told.err
    assert call(["repair", draft.ref.id, "--json"]) == 1
    told = capsys.readouterr()
    assert "what was there before is kept in /somewhere/.aside/1" in told.err
    assert json.loads(told.out)["error"] == "the disk is full"


@pytest.mark.parametrize("width", [0.0, 1.0, -0.2, float("nan")])
def test_a_width_is_a_share(width: float):
    with pytest.raises(ConfigError, match=r"evaluate --until-width.*width"):
        evaluate_checkpoint("0" * 16, {}, width, as_json=False)


def test_a_rate_is_told_with_what_the_policy_saw_and_with_what_was_found(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("JUICER_DATA", str(tmp_path))
    store = ArtifactStore(tmp_path)
    with store.create(Recipe("train", "checkpoint")) as checkpoint:
        checkpoint.summary["tasks"] = ["one_leg"]

    def measure(*arguments: Any) -> ArtifactRef:
        with store.create(Recipe("evaluate", "evaluation")) as draft:
            rows = [EvaluationRow(0, 3_000_000, Outcome.SUCCESS, 1, 9)]
            draft.summary |= facts(rows, get_task("one_leg").milestones)
            draft.summary |= {"label": "100% of 1 episodes, from images", "finding": "it saw images drawn by another"}
        return draft.ref

    monkeypatch.setattr("flows.stopping.measure_alone", measure)
    assert call(["evaluate", checkpoint.ref.id]) == 0
    told = capsys.readouterr().out
    assert "success 100% of 1 episodes, from images (95 % interval 21% to 100%); evaluation/" in told
    assert "it saw images drawn by another" in told
