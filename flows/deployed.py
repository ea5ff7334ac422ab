"""The flows as deployments offer them: forms of a few choices, or a whole configuration that is pasted.

What a form says is put together as a configuration file would say it, and checked as one before anything starts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from prefect import flow
from pydantic import Field, WithJsonSchema

from flows.conditions import of_one_task
from flows.config import RunConfig
from flows.running.body import run
from flows.running.execution import RunOutcome
from flows.running.runner import task_runner
from flows.runs import parse_runs
from flows.shipped import PRESETS, names
from flows.single_stage import run_stage
from juicer.tasks.task_name import TaskName
from stages.runtime.names import STAGES

Preset = Annotated[str, WithJsonSchema({"type": "string", "enum": names(PRESETS)})]
ConditionName = Annotated[str, WithJsonSchema({"type": "string", "enum": list(of_one_task())})]
"""A condition of the presets; those of one's own, or for several tasks, are for a configuration that is pasted."""
StageName = Annotated[str, WithJsonSchema({"type": "string", "enum": list(STAGES)})]
Pasted = Annotated[str, Field(json_schema_extra={"format": "json-string"})]
"""YAML; the format has Prefect's page show a field of several lines."""

_THE_FORM, _THE_PASTED = "the form", "the pasted configuration"
_SETTINGS: Any = {"task_runner": task_runner(), "persist_result": False}


@flow(name="collect_infer", flow_run_name="{task} {condition} seed {seed}", **_SETTINGS)
def loop(
    preset: Preset = "laptop",
    task: TaskName = "one_leg",
    condition: ConditionName = "ta_ci",
    seed: int = 0,
    overrides: list[str] = [],  # noqa: B006 (Prefect copies it, and shows it in the form)
) -> RunOutcome:
    """Train, improve and evaluate one model.

    Args:
        preset: Size of the networks and of their training. laptop: minutes on two CPU cores. smoke: seconds, and
            succeeds now and then. paper: needs a GPU.
        task: What the robot must build.
        condition: Which parts of the method are used. ta_ci is all of it: trajectory augmentation and collect-infer.
        seed: Number of the model among those that are trained alike.
        overrides: Further values, each as KEY=VALUE, for instance record.demonstrations=20 or randomness=med.
    """
    content = {"base": preset, "task": task, "condition": condition, "seed": seed}
    return run(_only(content, overrides))


@flow(name="study", flow_run_name="{task} study", **_SETTINGS)
def study(
    preset: Preset = "laptop",
    task: TaskName = "one_leg",
    conditions: list[ConditionName] = ["bc", "ta_ci"],  # noqa: B006 (as above)
    seeds: list[int] = [0],  # noqa: B006 (as above)
    overrides: list[str] = [],  # noqa: B006 (as above)
) -> RunOutcome:
    """Train and evaluate every condition with every seed, and compare them.

    Args:
        preset: Size of the networks and of their training. laptop: minutes a model on two CPU cores. smoke: seconds,
            and succeeds now and then. paper: needs a GPU.
        task: What the robot must build.
        conditions: What is compared.
        seeds: Numbers of the models that are trained for each condition; the paper has five.
        overrides: Further values, each as KEY=VALUE, for instance record.demonstrations=20 or randomness=med.
    """
    content = {
        "flow": "study",
        "base": preset,
        "task": task,
        "conditions": conditions,
        "seeds": seeds,
    }
    return run(_only(content, overrides))


@flow(name="configured_run", **_SETTINGS)
def configured(configuration: Pasted, overrides: list[str] = []) -> list[RunOutcome]:  # noqa: B006 (as above)
    """Run a whole configuration, as `juicer run` does.

    Args:
        configuration: What a configuration file holds, in YAML or JSON; `juicer config NAME` prints one. Paths in it
            must be absolute, and name files of the machine that serves.
        overrides: Further values, each as KEY=VALUE.
    """
    return [run(config) for config in parse_runs(configuration, _THE_PASTED, overrides)]


@flow(name="single_stage", flow_run_name="{stage} {task} {condition} seed {seed}", **_SETTINGS)
def stage_of_loop(
    stage: StageName = "train",
    preset: Preset = "laptop",
    task: TaskName = "one_leg",
    condition: ConditionName = "ta_ci",
    seed: int = 0,
    overrides: list[str] = [],  # noqa: B006 (as above)
    force: bool = False,
) -> list[str]:
    """Run one stage from inputs that are in the store.

    Args:
        stage: Which one.
        preset: As in the run whose stage it is.
        task: As in that run.
        condition: As in that run.
        seed: As in that run.
        overrides: As in that run.
        force: Whether to compute it even if its artifact is in the store.
    """
    content = {"base": preset, "task": task, "condition": condition, "seed": seed}
    return run_stage(stage, [_only(content, overrides)], force=force)


@flow(name="configured_stage", flow_run_name="{stage}", **_SETTINGS)
def configured_stage(
    configuration: Pasted,
    stage: StageName = "train",
    overrides: list[str] = [],  # noqa: B006 (as above)
    force: bool = False,
) -> list[str]:
    """Run one stage of a whole configuration, as `juicer stage` does.

    Args:
        configuration: What a configuration file holds, in YAML or JSON; `juicer config NAME` prints one. Paths in it
            must be absolute, and name files of the machine that serves.
        stage: Which one.
        overrides: Further values, each as KEY=VALUE.
        force: Whether to compute it even if its artifact is in the store.
    """
    return run_stage(stage, parse_runs(configuration, _THE_PASTED, overrides), force=force)


def _only(content: Mapping[str, Any], overrides: Sequence[str]) -> RunConfig:
    (config,) = parse_runs(content, _THE_FORM, overrides)
    return config
