"""Run a flow in thought: which stages it would call, with which recipes, without executing any."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from flows.config import RunConfig
from flows.execution import run_models
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ConfigError, did_you_mean
from stages.session import Session
from stages.stage import StageCall


@dataclass(frozen=True)
class PlannedCall:
    """A stage call that the flow would make.

    Attributes:
        call: The call.
        label: Condition, seed and round that it is made for first.
        exists: Whether its artifact is in the store.
    """

    call: StageCall
    label: str
    exists: bool

    @property
    def stage(self) -> str:
        """Name of the stage."""
        return self.call.stage.name

    @property
    def ref(self) -> ArtifactRef:
        """The artifact it makes."""
        return self.call.recipe.ref


def plan(store: ArtifactStore, config: RunConfig) -> list[PlannedCall]:
    """Every call of a run once, in an order in which they can be made; without the report, which depends on results."""
    planned: dict[str, PlannedCall] = {}

    def perform(call: StageCall, session: Session) -> ArtifactRef:
        if call.recipe.id not in planned:
            exists = store.find(call.recipe) is not None
            planned[call.recipe.id] = PlannedCall(call, session.label, exists)
        return call.recipe.ref

    run_models(Session(store, perform=perform), config, parallel=False)
    return list(planned.values())


def calls_of(planned: Iterable[PlannedCall], stage: str) -> list[PlannedCall]:
    """Calls of one stage.

    Raises:
        ConfigError: If the run has no such stage.
    """
    planned = list(planned)
    chosen = [entry for entry in planned if entry.stage == stage]
    if not chosen:
        known = {entry.stage for entry in planned}
        raise ConfigError(f"this configuration has no stage '{stage}'{did_you_mean(stage, known)}")
    return chosen


def missing_inputs(store: ArtifactStore, entry: PlannedCall, planned: Iterable[PlannedCall]) -> list[str]:
    """Names of the stages whose artifacts a call needs and the store lacks."""
    made_by = {other.ref: other.stage for other in planned if not other.exists}
    return sorted({made_by[ref] for ref in entry.call.recipe.parents if ref in made_by})
