"""One stage of a run, from inputs that are in the store."""

from __future__ import annotations

from prefect import flow

from flows.conditions import Condition
from flows.config import CollectInferConfig, StudyConfig
from flows.opening import expect, opened
from flows.plan import calls_of, missing_inputs, plan
from flows.run import task_runner
from flows.settings import read_settings
from juicer.errors import ConfigError
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
    with opened(read_settings(), None, PrefectPerformer(), forced=forced) as surroundings:
        store = surroundings.session.store
        planned = plan(store, config.narrowed(condition, seed))
        chosen = calls_of(planned, stage)
        for entry in chosen:
            if missing := missing_inputs(store, entry, planned):
                raise ConfigError(
                    f"stage '{stage}' ({entry.label}) needs what {', '.join(missing)} makes, and the store lacks it; "
                    f"run `juicer run`, or `juicer stage {missing[0]}` first"
                )
        expect(surroundings, chosen)
        return [str(entry.perform(surroundings.session)) for entry in chosen]
