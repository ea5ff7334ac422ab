"""Analyses of a study: which models they are of, what they are made from, and that they change nothing else."""

from __future__ import annotations

import pytest

from flows.config import StudyConfig
from flows.running.plan import plan
from flows.runs import parse_runs
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ConfigError

STUDY = """
base: smoke
flow: study
seeds: [3, 4]
conditions: [replay, bc, ta, mlp_chunked]
"""
ANALYSES = """
analyses:
  fig4: {kind: sampling, conditions: [bc]}
  modes: {kind: modes, samples: [16, 1], episodes: 2, conditions: [ta], every_seed: true}
  watched: {kind: monitor, watched_samples: 8}
"""


def planned(tmp_path, text):
    (config,) = parse_runs(text, "study")
    return plan(ArtifactStore(tmp_path), config)


def labels(calls, stage):
    return [entry.label for entry in calls if entry.stage == stage]


def test_models_that_draw_samples_are_analysed_of_the_first_seed_unless_more_is_asked(tmp_path):
    calls = planned(tmp_path, STUDY + ANALYSES)
    assert labels(calls, "sampling") == ["bc seed 3"]
    assert labels(calls, "modes") == ["ta seed 3", "ta seed 4"]
    assert labels(calls, "monitor") == ["bc seed 3", "ta seed 3"]


def test_each_number_of_samples_is_an_evaluation_and_that_of_one_is_the_final_one_if_as_long(tmp_path):
    text = STUDY + "analyses: {modes: {kind: modes, samples: [16, 1], conditions: [bc]}}"
    plain, more = planned(tmp_path, STUDY), planned(tmp_path, text)
    added = {entry.ref for entry in more} - {entry.ref for entry in plain}
    calls = {entry.ref: entry.call.recipe for entry in more}
    assert sorted(calls[ref].stage for ref in added) == ["evaluate", "modes"]
    (modes,) = [calls[ref] for ref in added if ref.kind == "analysis"]
    assert [calls[ref].config["samples"] for ref in modes.inputs["evaluations"]] == [1, 16]


def test_a_monitor_starts_where_the_evaluation_does(tmp_path):
    text = STUDY + ANALYSES + "randomness: med\nevaluate: {first: 40, episodes: 7, seed: 2}\n"
    calls = {entry.stage: entry.call.recipe.config for entry in planned(tmp_path, text)}
    for key in ("first", "episodes", "seed", "randomness", "max_steps"):
        assert calls["monitor"][key] == calls["evaluate"][key], key
    assert calls["monitor"]["watched_samples"] == 8


@pytest.mark.parametrize(
    ("analyses", "message"),
    [
        ("{a: {kind: monitor, conditions: [tb]}}", r"conditions\.bc\.changes: analyses\.a\.conditions: .* 'tb'"),
        (
            "{a: {kind: sampling, inference_steps: [101]}}",
            r"conditions\.bc\.changes: analyses\.a\.inference_steps: .*must",
        ),
    ],
)
def test_what_a_condition_alone_cannot_have_analysed_is_refused_at_once(analyses, message):
    text = STUDY.replace("[replay, bc, ta, mlp_chunked]", f"{{ta: {{}}, bc: {{changes: {{analyses: {analyses}}}}}}}")
    with pytest.raises(ConfigError, match=message):
        parse_runs(text, "study")


def test_a_study_that_is_run_seed_by_seed_analyses_the_same_models(tmp_path):
    (config,) = parse_runs(STUDY + ANALYSES, "study")
    parts = [config.narrowed([], [seed]) for seed in config.seeds]
    found = [labels(plan(ArtifactStore(tmp_path), part), "monitor") for part in parts]
    assert found == [["bc seed 3", "ta seed 3"], []]
    # Prefect validates what a flow is given once more.
    again = StudyConfig.model_validate(parts[1].model_dump(mode="json"))
    assert labels(plan(ArtifactStore(tmp_path), again.narrowed(["bc"], [])), "monitor") == []


@pytest.mark.parametrize(
    ("analyses", "message"),
    [
        ("{a: {kind: fig5}}", "sampling"),
        ("{a: {kind: modes, samples: [4, 4]}}", "each number may be there only once"),
        ("{a: {kind: monitor, conditions: [tb]}}", "no condition 'tb'"),
        ("{a: {kind: sampling, inference_steps: []}}", "inference_steps"),
        ("{a: {samples: 3}}", "kind"),
        ("{a: {kind: sampling, inference_steps: [1, 101]}}", "must not exceed train_timesteps, got 101 > 100"),
    ],
)
def test_what_cannot_be_analysed_is_refused_at_once(analyses, message):
    with pytest.raises(ConfigError, match=message):
        parse_runs(f"{STUDY}analyses: {analyses}", "study")


@pytest.mark.parametrize("kind", ["modes", "monitor"])
def test_an_analysis_of_more_initial_states_than_there_are_is_refused_before_the_training(kind):
    text = STUDY + f"evaluate: {{first: 1}}\nanalyses: {{long: {{kind: {kind}, episodes: 1000000}}}}"
    with pytest.raises(ConfigError, match=r"lower evaluate\.first or analyses\.long\.episodes"):
        parse_runs(text, "study")
