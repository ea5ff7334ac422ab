"""The flow by which a machine makes artifacts for runs on other machines."""

from __future__ import annotations

from typing import Any

from prefect import flow
from prefect.client.schemas.objects import State
from prefect.states import Completed, Failed

from flows.opening import opened
from flows.repair import rebuild_call
from flows.run import task_runner
from flows.settings import read_settings
from flows.spread import MAKE, failure_message
from juicer.artifacts.recipe import Recipe
from juicer.errors import ArtifactError, JuicerError
from stages.prefect_task import PrefectPerformer
from stages.stage import StageCall


@flow(name=MAKE, task_runner=task_runner(), persist_result=False)
def make(recipe: dict[str, Any], label: str = "") -> State[Any]:
    """Make the artifact of a recipe, unless it is in the store."""
    try:
        call = _call(Recipe.from_json(recipe))
        with opened(read_settings(), None, PrefectPerformer()) as surroundings:
            session = surroundings.session
            ref = session.perform(call, session.for_model(label, session.record))
    except JuicerError as error:
        return Failed(message=failure_message(error))
    return Completed(message=str(ref))


def _call(recipe: Recipe) -> StageCall:
    try:
        return rebuild_call(recipe, None)
    except ArtifactError as error:
        raise ArtifactError(
            f"a machine that serves stages has another juicer than the one that asks: {error}"
        ) from None
