"""A stage says of itself what is worth saying of its artifact."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

from juicer.artifacts.manifest import HEADLINE, LABEL
from stages.evaluate import _texts
from stages.runtime.facts import StageFacts
from stages.runtime.names import STAGES


def test_headline_has_the_facts_in_the_order_of_the_stage_and_the_finding():
    facts = StageFacts("snippets", "snippets", ("yield", "snippets", "train/loss"))
    summary = {"snippets": 96, "yield": 0.5, "other": "x", "train/loss": 0.123456}
    texts = {HEADLINE: "yield 0.5, snippets 96, loss 0.123", LABEL: "96 snippets"}
    assert facts.texts(summary) == texts
    assert facts.texts({"finding": "nothing"}) == {HEADLINE: "nothing"}


def test_headline_tells_units_behind_their_numbers():
    facts = StageFacts("steps", "steps", ("validation/position_error_mm", "simulated_s"))
    assert facts.texts({"validation/position_error_mm": 7.291, "simulated_s": 2}) == {
        HEADLINE: "position error 7.29 mm, simulated 2 s"
    }


def test_what_a_body_says_of_its_artifact_stays():
    assert StageFacts("words", "words").texts({"words": 2, LABEL: "two words"}) == {}


def test_headline_of_an_evaluation_is_its_rate_with_interval():
    texts = _texts({"success_rate": 0.5, "episodes": 100, "interval_low": 0.4, "interval_high": 0.6})
    assert texts == {HEADLINE: "success 50% of 100 episodes (40% to 60%)", LABEL: "50% of 100 episodes"}


@pytest.mark.parametrize("name", STAGES)
def test_every_module_of_the_package_is_a_stage(name):
    assert getattr(importlib.import_module(f"stages.{name}"), name).name == name


def test_names_of_stages_cost_no_import_of_them():
    code = "import sys, stages.runtime.names; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert not {"torch", "mujoco", "prefect", "mlflow", "stages.train", "juicer"} & set(loaded)
