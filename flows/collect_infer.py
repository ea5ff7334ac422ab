"""One model of one condition: demonstrations, augmentation, training, and any number of collect-infer rounds."""

from __future__ import annotations

from prefect import flow

from flows.config import CollectInferConfig
from flows.running.body import run
from flows.running.execution import RunOutcome
from flows.running.runner import task_runner


@flow(name="collect_infer", flow_run_name="{config.name}", task_runner=task_runner(), persist_result=False)
def collect_infer(config: CollectInferConfig) -> RunOutcome:
    """Train, improve and evaluate one model; retraining is training with more data."""
    return run(config)
