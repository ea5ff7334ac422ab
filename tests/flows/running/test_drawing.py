"""A run of policies that look at images says before it begins that nothing can draw them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from flows.running.plan import plan, require_drawing
from flows.runs import parse_runs
from juicer.artifacts.store import ArtifactStore
from juicer.errors import RenderingUnavailable


@pytest.fixture(autouse=True)
def nothing_draws(monkeypatch):
    def refuse():
        raise RenderingUnavailable("no OpenGL platform can draw an image here")

    monkeypatch.setattr("juicer.imaging.gl.gl_name", refuse)


def planned(tmp_path, preset):
    (config,) = parse_runs({"base": preset, "condition": "bc"}, "here")
    return plan(ArtifactStore(tmp_path), config)


@pytest.mark.parametrize("preset", ["laptop_image", "laptop_image_e2e"])
def test_a_run_that_looks_at_images_is_refused_where_nothing_draws_unless_it_is_made_already(tmp_path, preset):
    calls = planned(tmp_path, preset)
    with pytest.raises(RenderingUnavailable):
        require_drawing(calls)
    require_drawing(replace(each, exists=True) for each in calls)


def test_a_run_on_states_needs_nothing_that_draws(tmp_path):
    require_drawing(planned(tmp_path, "laptop"))
