"""The flow by which a machine makes artifacts for runs on other machines."""

from __future__ import annotations

import platform
from typing import Any

from prefect import flow
from prefect.client.schemas.objects import State
from prefect.runtime import flow_run
from prefect.states import Completed, Failed

from flows.remote.dispatch import MAKE, failure_message
from flows.running.body import task_runner
from flows.running.context import open_run
from flows.running.data_folder import open_store
from flows.running.flow_runs import held
from flows.running.repair import rebuild_call
from flows.running.settings import read_settings
from juicer.artifacts.recipe import Recipe
from juicer.errors import ArtifactError, ConfigError, JuicerError, NothingLeft
from stages.runtime.prefect_task import PrefectPerformer
from stages.runtime.stage import Origins, StageCall


@flow(name=MAKE, task_runner=task_runner(), persist_result=False)
def make(recipe: dict[str, Any], label: str = "", force: bool = False) -> State[Any]:
    """Make one artifact for a run that another machine has begun; runs ask for it by themselves.

    Args:
        recipe: What it is made of.
        label: Condition, seed and round that it is made for.
        force: Whether to make it even if it is in the store.
    """
    try:
        settings = read_settings()
        call = _call(recipe, open_store(settings))
        forced = frozenset({call.stage.name}) if force else frozenset()
        with (
            held(settings.folder, flow_run.get_id()),
            open_run(settings, None, PrefectPerformer(), forced=forced) as run_context,
        ):
            session = run_context.session
            ref = session.for_model(label, session.record).perform(call)
    except NothingLeft as finding:
        # What data lack, they lack anywhere; it is reported, and reports are the same wherever they are made.
        return Failed(message=failure_message(finding))
    except JuicerError as error:
        return Failed(message=failure_message(error, platform.node()))
    return Completed(message=str(ref))


def _call(recipe: dict[str, Any], origins: Origins) -> StageCall:
    try:
        return rebuild_call(Recipe.from_json(recipe), None, origins)
    except (ArtifactError, ConfigError, ValueError, KeyError, TypeError) as error:
        raise ArtifactError(
            f"a machine that serves stages has another juicer, or other libraries, than the one that asks: {error}"
        ) from None
