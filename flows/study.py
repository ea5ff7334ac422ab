"""Conditions times seeds, compared in the form of the paper's Table VI."""

from __future__ import annotations

from prefect import flow

from flows.config import StudyConfig
from flows.running.body import run
from flows.running.execution import RunOutcome
from flows.running.runner import task_runner


@flow(name="study", flow_run_name="{config.name}", task_runner=task_runner(), persist_result=False)
def study(config: StudyConfig) -> RunOutcome:
    """Train and evaluate every condition with every seed; what they have in common is made once."""
    return run(config)
