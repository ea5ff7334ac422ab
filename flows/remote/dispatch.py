"""A run's stages on other machines: each travels as its recipe to whichever of them serves ``make``.

The machines share the artifact store and the Prefect server, and nothing else: no pickled code, no open connection.
"""

from __future__ import annotations

import time
from contextlib import suppress
from typing import cast
from uuid import UUID

import httpx
from prefect import get_client
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.objects import DeploymentStatus, FlowRun, State
from prefect.deployments import run_deployment
from prefect.exceptions import ObjectNotFound
from prefect.runtime import task_run
from prefect.states import Cancelling

import juicer.errors
from flows.running.settings import Settings
from juicer.errors import ArtifactError, JuicerError, ServiceUnavailable, StageDied
from stages.runtime.context import StageInterrupted
from stages.runtime.session import Sender, Session
from stages.runtime.stage import StageCall

MAKE, DEPLOYMENT = "make", "worker"
POLL_SECONDS = 2.0
PATIENCE_SECONDS = 120.0
"""How long a stage waits while no machine offers to run it; Prefect takes one to find out that a machine is gone."""


def sender(settings: Settings) -> Sender | None:
    """What sends stages to other machines, if they are to run there."""
    return send if settings.spread else None


def send(call: StageCall, session: Session) -> None:
    """Have another machine make an artifact, and wait for it.

    Raises:
        ServiceUnavailable: If no machine offers to.
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
                parameters={
                    "recipe": call.recipe.to_json(),
                    "label": session.label,
                    "force": call.stage.name in session.forced,
                },
                flow_run_name=name,
                timeout=0,
                # A task that is tried again finds its flow run, in case only the answer was lost.
                idempotency_key=task_run.id,
            ),
        )
    except ObjectNotFound:
        raise _nobody_serves() from None
    with get_client(sync_client=True) as client:
        state = _final_state(client, run, session)
    if not state.is_completed():
        raise _error(name, state)
    if session.store.find(call.recipe) is None:
        raise ArtifactError(
            f"another machine has made {call.recipe.ref}, but not in '{session.store.url}'; "
            "set JUICER_STORE to one place for all of them"
        )


def _final_state(client: SyncPrefectClient, run: FlowRun, session: Session) -> State:
    waits_until = time.monotonic() + PATIENCE_SECONDS
    while True:
        try:
            state = client.read_flow_run(run.id).state
            if state is not None and state.is_final():
                return state
            if state is None or not state.is_scheduled() or _is_served(client, run.deployment_id):
                waits_until = time.monotonic() + PATIENCE_SECONDS
        except httpx.TransportError:
            # The stage works on without the server; so does whoever waits for it.
            waits_until = time.monotonic() + PATIENCE_SECONDS
        if session.stop.wait(POLL_SECONDS):
            _cancel(client, run)
            raise StageInterrupted
        if time.monotonic() > waits_until:
            _cancel(client, run)
            raise _nobody_serves()


def _cancel(client: SyncPrefectClient, run: FlowRun) -> None:
    # A server that is away cannot be told.
    with suppress(httpx.TransportError):
        client.set_flow_run_state(run.id, Cancelling())


def _is_served(client: SyncPrefectClient, deployment: UUID | None) -> bool:
    return deployment is not None and client.read_deployment(deployment).status == DeploymentStatus.READY


def _nobody_serves() -> ServiceUnavailable:
    return ServiceUnavailable(
        "no machine offers to run stages; start `juicer serve` where they should run, or unset JUICER_SPREAD"
    )


def failure_message(error: JuicerError, place: str = "") -> str:
    """What a failed flow run says of an error, so that it can be raised again elsewhere."""
    return f"{type(error).__name__}: {error}" + (f" (on {place})" if place else "")


def _error(name: str, state: State) -> JuicerError:
    """The error that a flow run's message tells of."""
    kind, _, sentence = (state.message or "").partition(": ")
    found = getattr(juicer.errors, kind, None)
    if isinstance(found, type) and issubclass(found, JuicerError):
        error: JuicerError = found(sentence)
        return error
    reason = state.message or "no reason is known"
    return StageDied(f"stage '{name}' ended as {state.name} on another machine: {reason}")
