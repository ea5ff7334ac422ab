"""One stage of a run, from inputs that are in the store."""

from __future__ import annotations

from collections.abc import Sequence

from prefect import flow
from prefect.runtime import flow_run

from flows.config import CollectInferConfig, RunConfig, StudyConfig
from flows.opening import expect, opened
from flows.plan import ready_calls
from flows.run import task_runner
from flows.servers.flow_runs import held
from flows.settings import read_settings
from flows.spread import sender
from stages.prefect_task import PrefectPerformer


@flow(name="single_stage", flow_run_name="{stage}", task_runner=task_runner(), persist_result=False)
def single_stage(stage: str, configs: list[CollectInferConfig | StudyConfig], force: bool = False) -> list[str]:
    """Run every call of a stage that configurations make; with ``force`` even if its artifact is in the store."""
    return run_stage(stage, configs, force=force)


def run_stage(stage: str, configs: Sequence[RunConfig], *, force: bool) -> list[str]:
    """The same within a flow run; gives the artifacts."""
    settings = read_settings()
    forced = frozenset({stage}) if force else frozenset()
    with (
        held(settings.folder, flow_run.get_id()),
        opened(settings, None, PrefectPerformer(), send=sender(settings), forced=forced) as surroundings,
    ):
        chosen = [entry for config in configs for entry in ready_calls(surroundings.session.store, config, stage)]
        expect(surroundings, chosen)
        return [str(entry.perform(surroundings.session)) for entry in chosen]
