"""Policies and conditions are data: a configuration defines them, and their names shape no result."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest
from pydantic import ValidationError

from flows.command.choice import Choice
from flows.conditions import Condition, defaults, shipped
from flows.config import CollectInferConfig, StudyConfig
from flows.running.execution import execute
from flows.running.plan import calls_of, plan
from flows.runs import load_runs
from juicer.artifacts.store import ArtifactStore
from juicer.config import canonical_json
from juicer.errors import ConfigError
from juicer.reporting.paper import PAPER_TABLE_VI
from stages.report import PAGE
from stages.runtime.execution import perform_here
from stages.runtime.session import Session

TWO_HEADS = """
base: smoke
flow: study
name: heads
seeds: [0]
policies:
  diffusion: {training: {steps: 30, warmup_steps: 5, validation_fraction: 0.5, windows: {back_padding: 15}}}
  convolution: {base: diffusion, policy: {head: {denoiser: {kind: unet, channels: [8, 8, 16]}}}}
  regression: {base: diffusion, policy: {head: {kind: mlp, width: 32, blocks: 1}}}
  again: {base: diffusion}
conditions:
  denoised: {title: "Diffusion, U-Net", policy: convolution}
  regressed: {title: Regression, policy: regression}
  same_twice: {policy: again}
  bc: {}
record: {demonstrations: 2}
evaluate: {episodes: 1, max_steps: 20}
"""


DOCUMENTATION = Path(__file__).parents[2] / "docs" / "configuration.md"


def write(path, text):
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Two heads, and one policy under two names: really trained, evaluated and reported."""
    folder = tmp_path_factory.mktemp("heads")
    (config,) = load_runs(write(folder / "heads.yaml", TWO_HEADS))
    store = ArtifactStore(folder / "data")
    return store, config, execute(Session(store, performer=perform_here), config, None)


def test_two_heads_are_compared_by_writing_yaml(compared):
    store, _, outcome = compared
    trained = [store.manifest(model.checkpoint).recipe.config["policy"]["head"] for model in outcome.models]
    assert [head["kind"] for head in trained] == ["diffusion", "mlp", "diffusion", "diffusion"]
    assert [head["denoiser"]["kind"] for head in trained if "denoiser" in head] == ["unet", "mlp", "mlp"]
    assert [(row.condition, row.title) for row in outcome.results(store)] == [
        ("denoised", "Diffusion, U-Net"),
        ("regressed", "Regression"),
        ("same_twice", "same_twice"),
        ("bc", "BC"),
    ]
    page = (store.open(outcome.report) / PAGE).read_text()
    assert "<td>Diffusion, U-Net</td>" in page
    assert "<td>same_twice</td>" in page
    average, best = PAPER_TABLE_VI["one_leg"]["bc"]
    assert page.count(f"{average:.0%} / {best:.0%}") == 1


def test_conditions_that_say_the_same_share_every_artifact(compared):
    store, _, outcome = compared
    *_, twice, bc = outcome.models
    assert (twice.checkpoint, twice.evaluation) == (bc.checkpoint, bc.evaluation)
    assert len(store.list("checkpoint")) == len(store.list("evaluation")) == 3


def test_no_recipe_but_that_of_the_report_holds_the_name_or_title_of_a_condition_or_policy(compared):
    store, config, _ = compared
    words = {"denoised", "regressed", "same_twice", "convolution", "again", "Regression", "Diffusion, U-Net", "bc"}
    assert words >= {*config.conditions, *config.policies} - {*defaults()["policies"], "regression"}
    for entry in plan(store, config):
        found = {word for word in words if f'"{word}"' in canonical_json(entry.call.recipe.config)}
        assert (found == set()) == (entry.stage != "report"), entry.stage


def test_another_title_changes_the_report_alone(compared):
    store, _, _ = compared
    (config,) = load_runs(write(store.cache.parent / "titled.yaml", TWO_HEADS.replace("Regression,", "Baseline,")))
    assert {entry.stage for entry in plan(store, config) if not entry.exists} == {"report"}


def test_a_study_without_a_row_of_the_paper_shows_none_of_its_figures(compared):
    store, config, _ = compared
    outcome = execute(Session(store, performer=perform_here), config.narrowed(("regressed",), ()), None)
    assert "paper, average / best" not in (store.open(outcome.report) / PAGE).read_text()


def test_the_conditions_of_the_paper_are_those_of_its_table():
    for figures in PAPER_TABLE_VI.values():
        assert set(figures) == set(defaults()["conditions"]) - {"replay"}


def test_a_mapping_of_conditions_changes_those_that_come_along_and_adds_others(tmp_path):
    text = "flow: study\nconditions: {bc: {}, ta_ci: {rounds: 3}, noisy: {augment: true, state_noise: true}}\n"
    (study,) = load_runs(write(tmp_path / "run.yaml", text), ["seeds=[0]"])
    assert study.conditions["bc"] == shipped("bc")
    assert (study.conditions["ta_ci"].title, study.conditions["ta_ci"].augment) == ("TA+CI", True)
    assert study.conditions["noisy"].title == "noisy"
    planned = plan(ArtifactStore(tmp_path / "data"), study)
    assert Counter(entry.label.split()[0] for entry in calls_of(planned, "collect")) == {"ta_ci": 3}
    noisy = [entry.call.recipe.config for entry in calls_of(planned, "train") if entry.label == "noisy seed 0"]
    assert [config["training"]["state_noise"]["kind"] for config in noisy] == ["physical"]


def test_corrections_are_of_conditions_that_collect():
    with pytest.raises(ValidationError, match="add collect: true, or leave out correct"):
        Condition(title="DAgger", augment=True, correct=True)


def test_a_list_of_conditions_picks_from_those_that_the_base_defines(tmp_path):
    write(tmp_path / "base.yaml", TWO_HEADS.replace("base: smoke\n", ""))
    path = write(tmp_path / "run.yaml", "base: base.yaml\nconditions: [regressed, ta]\n")
    (study,) = load_runs(path)
    assert [condition.title for condition in study.conditions.values()] == ["Regression", "TA"]
    for (picked,) in (
        load_runs(tmp_path / "base.yaml", ["conditions=[regressed]"]),
        Choice.of(str(tmp_path / "base.yaml"), None, None, ["regressed"], None).runs(),
    ):
        assert picked.conditions == {"regressed": study.conditions["regressed"]}
    with pytest.raises(ConfigError, match="the study has no condition 'regresed'; did you mean 'regressed'"):
        Choice.of(str(tmp_path / "base.yaml"), None, None, ["regresed"], None).runs()


def test_one_model_may_be_of_a_condition_of_ones_own(tmp_path):
    path = write(tmp_path / "run.yaml", "condition: mine\nconditions: {mine: {policy: mlp_chunked, augment: true}}\n")
    (run,) = load_runs(path)
    assert run.method("mine").policy == "mlp_chunked"
    assert CollectInferConfig.model_validate_json(run.model_dump_json()) == run
    (other,) = Choice.of(str(path), None, None, ["bc"], None).runs()
    assert other.models == (("bc", 0),)
    with pytest.raises(ConfigError, match="condition: unknown condition 'mien'; did you mean 'mine'"):
        load_runs(path, ["condition=mien"])


def test_a_policy_has_what_its_base_has_and_knows_where_that_was_written(tmp_path):
    text = "base: laptop\npolicies: {wide: {base: diffusion, training: {steps: 9000}}}\n"
    path = write(tmp_path / "run.yaml", text)
    (run,) = load_runs(path, ["policies.diffusion.policy.head.denoiser.width=640"])
    wide, narrow = run.policies["wide"], run.policies["diffusion"]
    assert wide.policy == narrow.policy
    assert (wide.training.steps, wide.training.batch_size) == (9000, narrow.training.batch_size)
    written = Choice.of(str(path), None, None, None, None).written()
    assert written.place(("policies", "wide", "training", "batch_size")) == "presets/laptop.yaml:18"
    assert written.place(("policies", "wide", "training", "steps")).endswith("run.yaml:2")


def test_a_study_is_the_same_after_a_journey_as_json(tmp_path):
    (study,) = load_runs(write(tmp_path / "run.yaml", TWO_HEADS))
    assert StudyConfig.model_validate_json(study.model_dump_json()) == study
    assert StudyConfig().model_dump(mode="json")["conditions"] == list(StudyConfig().conditions)


def test_every_configuration_of_the_documentation_is_valid(tmp_path):
    blocks = re.findall(r"```yaml\n(.*?)```", DOCUMENTATION.read_text(), re.DOTALL)
    assert len(blocks) >= 4
    studies = {run.name: run for text in blocks for run in load_runs(write(tmp_path / "run.yaml", text))}
    heads = studies["my_heads"]
    assert heads.method("bc_unet").title == "BC, U-Net"
    assert heads.policies["unet"].policy.head.denoiser.channels == (64, 128, 256)


def test_a_condition_knows_of_which_method_it_is():
    (config,) = (run for run in load_runs("paper_study") if run.task == "one_leg")
    methods = {name: config.method(name).method for name in config.conditions}
    assert {name: methods[name] for name in ("bc", "ta_ci", "human_mlp_chunked", "ten_ta_ci_4", "med_replay")} == {
        "bc": "bc",
        "ta_ci": "ta_ci",
        "human_mlp_chunked": "mlp_chunked",
        "ten_ta_ci_4": "ta_ci",
        "med_replay": "replay",
    }
    assert methods["ten_dagger_4"] == methods["med_flow"] == ""
