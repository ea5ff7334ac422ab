"""What deployments offer: short forms that mean what they say."""

from __future__ import annotations

import pytest
from prefect.utilities.callables import parameter_schema

from flows import deployed
from flows.conditions import defaults
from flows.deployed import configured, configured_stage, loop, stage_of_loop, study
from juicer.errors import ConfigError

FORMS = [loop, study, configured, stage_of_loop, configured_stage]
LAMP = "base: smoke\ntask: lamp\ncondition: bc\nrecord: {demonstrations: 3}  # few\n"


@pytest.fixture
def runs(monkeypatch):
    """Configurations that a form has asked to run."""
    asked = []
    monkeypatch.setattr(deployed, "run", asked.append)
    monkeypatch.setattr(deployed, "run_stage", lambda stage, configs, force: asked.append((stage, *configs, force)))
    return asked


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.name)
def test_a_form_has_few_fields_and_every_one_is_described(form):
    fields = parameter_schema(form.fn).properties
    assert len(fields) <= 8
    assert all(field["description"] for field in fields.values())
    assert form.description


def test_what_is_one_of_few_is_a_choice():
    fields = parameter_schema(stage_of_loop.fn).model_dump_for_openapi()["properties"]
    assert fields["task"]["enum"] == ["one_leg", "round_table", "lamp", "square_table"]
    images = {"laptop_image", "laptop_image_e2e", "paper_image"}
    assert set(fields["preset"]["enum"]) == {"laptop", "paper", "smoke"} | images
    assert "train" in fields["stage"]["enum"]
    assert fields["condition"]["enum"] == [name for name in defaults()["conditions"] if name != "multitask"]
    several = parameter_schema(study.fn).model_dump_for_openapi()["properties"]["conditions"]
    assert several["items"]["enum"] == fields["condition"]["enum"]


def test_an_unchanged_form_trains_for_a_laptop(runs):
    loop.fn()
    (config,) = runs
    assert config.task == "one_leg"
    assert config.policies["diffusion"].training.steps == 8000
    assert config.policies["diffusion"].policy.head.denoiser.kind == "mlp"


def test_a_task_that_is_chosen_is_the_task_of_every_stage(runs):
    loop.fn(preset="smoke", task="lamp", condition="bc", seed=2, overrides=["evaluate.episodes=7"])
    study.fn(preset="smoke", task="lamp", conditions=["bc", "ta"], seeds=[0, 1])
    one, several = runs
    assert (one.task, one.condition, one.seed, one.evaluate.episodes) == ("lamp", "bc", 2, 7)
    assert (several.task, list(several.conditions), several.seeds) == ("lamp", ["bc", "ta"], (0, 1))
    for config in runs:
        assert config.recording.task == config.evaluation.task == "lamp"


def test_a_whole_configuration_is_pasted(runs):
    configured.fn(LAMP, ["record.demonstrations=2"])
    configured_stage.fn(LAMP, stage="evaluate", force=True)
    whole, (stage, config, force) = runs
    assert (whole.task, whole.record.demonstrations) == ("lamp", 2)
    assert (stage, config.record.demonstrations, force) == ("evaluate", 3, True)


@pytest.mark.parametrize(
    ("form", "arguments", "sentence"),
    [
        (loop, {"task": "lmap"}, "did you mean 'lamp'"),
        (loop, {"overrides": ["record.task=one_leg"]}, "record.task"),
        (loop, {"preset": "labtop"}, "did you mean 'laptop'"),
        (loop, {"overrides": ["logs=recordings"]}, "must be an absolute path"),
        (configured, {"configuration": "task: lamp\ntask: one_leg\n"}, "'task'"),
        (configured, {"configuration": "- 1"}, "must hold a mapping"),
        (configured, {"configuration": "logs: recordings"}, "must be an absolute path"),
        (configured, {"configuration": "{" * 100_000}, "a key must be a word"),
        (configured, {"configuration": "a" * 10_000_000}, "longer than"),
    ],
)
def test_a_mistake_in_a_form_is_told_before_anything_starts(runs, form, arguments, sentence):
    with pytest.raises(ConfigError, match=sentence):
        form.fn(**arguments)
    assert runs == []
