"""A run's stages on other machines: each travels as its recipe to whichever of them serves ``make``.

The machines share the artifact store and the Prefect server, and nothing else: no pickled code, no open connection.
"""

from __future__ import annotations

from typing import cast
from uuid import UUID

from prefect import get_client
from prefect.client.schemas.objects import FlowRun, State
from prefect.deployments import run_deployment
from prefect.exceptions import ObjectNotFound
from prefect.states import Cancelling

import juicer.errors
from juicer.errors import ArtifactError, JuicerError, ServiceUnavailable, StageDied
from stages.session import Session, StageInterrupted
from stages.stage import StageCall

MAKE, DEPLOYMENT = "make", "anywhere"
POLL_SECONDS = 2.0


def send(call: StageCall, session: Session) -> None:
    """Have another machine make an artifact, and wait for it.

    Raises:
        ServiceUnavailable: If no machine has ever offered to.
        StageInterrupted: If the user asked for an end.
        ArtifactError: If the other machine has another store.
        JuicerError: Whatever the stage raised there.
    """
    name = f"{call.stage.name} {session.label}".strip()
    try:
        run = cast(
            "FlowRun",
            run_deployment(
                f"{MAKE}/{DEPLOYMENT}",
                parameters={"recipe": call.recipe.to_json(), "label": session.label},
                flow_run_name=name,
                timeout=0,
            ),
        )
    except ObjectNotFound:
        raise ServiceUnavailable(
            "no machine has offered to run stages; start `juicer serve` where they should run, or unset JUICER_SPREAD"
        ) from None
    state = _final_state(run.id, session)
    if not state.is_completed():
        raise _error(name, state)
    if session.store.find(call.recipe) is None:
        raise ArtifactError(
            f"another machine has made {call.recipe.ref}, but not in '{session.store.url}'; "
            "set JUICER_STORE to one place for all of them"
        )


def _final_state(flow_run: UUID, session: Session) -> State:
    with get_client(sync_client=True) as client:
        while True:
            state = client.read_flow_run(flow_run).state
            if state is not None and state.is_final():
                return state
            if session.stop.wait(POLL_SECONDS):
                client.set_flow_run_state(flow_run, Cancelling(), force=True)
                raise StageInterrupted


def failure_message(error: JuicerError) -> str:
    """What a failed flow run says of an error, so that it can be raised again elsewhere."""
    return f"{type(error).__name__}: {error}"


def _error(name: str, state: State) -> JuicerError:
    """The error that a flow run's message tells of."""
    kind, _, sentence = (state.message or "").partition(": ")
    found = getattr(juicer.errors, kind, None)
    if isinstance(found, type) and issubclass(found, JuicerError):
        error: JuicerError = found(sentence)
        return error
    reason = state.message or "no reason is known"
    return StageDied(f"stage '{name}' ended as {state.name} on another machine: {reason}")
