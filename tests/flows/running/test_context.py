"""What a run expects of the stages to come."""

from __future__ import annotations

from dataclasses import replace

import pytest

from flows.config import CollectInferConfig
from flows.running.context import RunContext, expect
from flows.running.plan import plan
from flows.terminal.progress import Board
from juicer.artifacts.catalog import catalog_of
from juicer.artifacts.store import ArtifactStore
from stages.runtime.execution import perform_here
from stages.runtime.session import Session


def test_a_stage_may_take_as_long_as_the_last_one_with_its_configuration(tmp_path):
    store, board = ArtifactStore(tmp_path), Board()
    first, *_ = planned = plan(store, CollectInferConfig())
    recipe = first.call.recipe
    for changed in ({"seed": 7}, {"demonstrations": 3}):
        with store.create(replace(recipe, config={**recipe.config, **changed})):
            pass
    seconds = {manifest.recipe.config["seed"]: manifest.seconds for manifest in store.list()}
    expect(RunContext(Session(store, perform_here), board, None), planned, tmp_path)
    expected = board._forecast.expected
    assert expected[str(first.ref)].seconds == seconds[7]
    assert [artifact for artifact, call in expected.items() if call.seconds is not None] == [str(first.ref)]


def test_the_next_run_that_starts_reads_no_manifest_again(tmp_path, monkeypatch):
    store = ArtifactStore(tmp_path)
    first, *_ = planned = plan(store, CollectInferConfig())
    recipe = first.call.recipe
    with store.create(replace(recipe, config={**recipe.config, "seed": 7})):
        pass
    expect(RunContext(Session(store, perform_here), Board(), None), planned, tmp_path)
    catalog_of.cache_clear()
    monkeypatch.setattr(ArtifactStore, "manifest", lambda self, ref: pytest.fail(f"{ref} is read again"))
    board = Board()
    expect(RunContext(Session(store, perform_here), board, None), planned, tmp_path)
    assert board._forecast.expected[str(first.ref)].seconds is not None
