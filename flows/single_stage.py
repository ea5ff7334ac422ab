"""One stage of a run, from inputs that are in the store."""

from __future__ import annotations

from prefect import flow
from prefect.runtime import flow_run

from flows.conditions import Condition
from flows.config import CollectInferConfig, StudyConfig
from flows.opening import expect, opened
from flows.plan import ready_calls
from flows.run import task_runner
from flows.servers.flow_runs import held
from flows.settings import read_settings
from flows.spread import sender
from stages.prefect_task import PrefectPerformer


@flow(name="single_stage", flow_run_name="{stage} of {config.name}", task_runner=task_runner(), persist_result=False)
def single_stage(
    stage: str,
    config: CollectInferConfig | StudyConfig,
    condition: Condition | None = None,
    seed: int | None = None,
    force: bool = False,
) -> list[str]:
    """Run every call of a stage that a configuration makes; with ``force`` even if its artifact is in the store."""
    forced = frozenset({stage}) if force else frozenset()
    settings = read_settings()
    with (
        held(settings.folder, flow_run.get_id()),
        opened(settings, None, PrefectPerformer(), send=sender(settings), forced=forced) as surroundings,
    ):
        chosen = ready_calls(surroundings.session.store, config.narrowed(condition, seed), stage)
        expect(surroundings, chosen)
        return [str(entry.perform(surroundings.session)) for entry in chosen]
