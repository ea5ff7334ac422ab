"""A page of several tasks tells once where its models come from."""

from __future__ import annotations

import pytest

from juicer.artifacts import store
from juicer.reporting.sources import origins_of
from tests.study.conftest import Made


@pytest.fixture
def at_commit(monkeypatch):
    """Makes an evaluation, and its checkpoint, at a commit."""

    def made_at(made: Made, commit: str, condition: str, checkpoint=None):
        monkeypatch.setattr(store, "describe_host", lambda: {"commit": commit, "name": "here", "juicer": "0.1.0"})
        checkpoint = checkpoint or made.artifact("train", "checkpoint", config={"of": condition})
        made.evaluation(condition, checkpoint)
        return checkpoint

    return made_at


def test_a_commit_is_named_once_with_all_its_models(tmp_path, at_commit):
    one_leg, lamp = Made(tmp_path / "store"), Made(tmp_path / "store", "lamp")
    at_commit(one_leg, "a" * 40, "bc")
    at_commit(one_leg, "b" * 40, "ta")
    at_commit(lamp, "a" * 40, "ci")
    origins = origins_of([one_leg.study.sources, lamp.study.sources])
    assert origins["Trained at commit"] == f"{'a' * 40} (2); {'b' * 40} (1)"
    assert origins["Evaluated at commit"] == origins["Trained at commit"]


def test_a_model_that_two_tasks_share_counts_once(tmp_path, at_commit):
    one_leg, lamp = Made(tmp_path / "store"), Made(tmp_path / "store", "lamp")
    shared = at_commit(one_leg, "a" * 40, "multitask")
    at_commit(lamp, "b" * 40, "multitask", shared)
    origins = origins_of([one_leg.study.sources, lamp.study.sources])
    assert origins["Trained at commit"] == "a" * 40
    assert origins["Evaluated at commit"] == f"{'a' * 40} (1); {'b' * 40} (1)"
