"""One stage of a run, from inputs that are in the store."""

from __future__ import annotations

from collections.abc import Sequence

from prefect import flow
from prefect.runtime import flow_run

from flows.config import CollectInferConfig, RunConfig, StudyConfig
from flows.running.context import expect, open_run
from flows.running.flow_runs import held
from flows.running.plan import ready_calls
from flows.running.runner import opener, task_runner
from flows.running.settings import read_settings
from stages.runtime.prefect_task import PrefectPerformer


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
        open_run(settings, None, PrefectPerformer(opener(settings)), forced=forced) as run_context,
    ):
        chosen = ready_calls(run_context.session.store, configs, stage)
        expect(run_context, chosen, settings.folder)
        return [str(entry.perform(run_context.session)) for entry in chosen]
