"""What the stages of one flow run share: the store, who listens to them, and how much of the machine they may use."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from stages.runtime.context import Display, NoRecord, Record, SilentDisplay
from stages.runtime.machine import Machine
from stages.runtime.stage import StageCall

ROUND = " round "


@dataclass(frozen=True)
class Session:
    """Surroundings of a stage call; none of it shapes a result.

    Attributes:
        store: Where artifacts come from and go to.
        performer: Runs a prepared call: at once, as a Prefect task, or only in thought.
        display: Shows progress.
        record: Keeps the experiment's history.
        machine: How much of this machine a stage may use.
        isolate: Whether each stage body gets a process of its own.
        label: Which condition, seed and round the calls are for.
        forced: Names of stages that are recomputed even if their artifact is in the store.
        stop: Set when the user asked for an end.
        fresh: Ids made since the session began; they satisfy ``forced``.
        recipes: Of every artifact that was called for since the session began, made or not.
        held: By files that people go on writing, the copies that the session works with from its first use to its end.
        listed: By folders to which people go on adding files, those that the session works with from its first use on.
    """

    store: ArtifactStore
    performer: Performer
    display: Display = field(default_factory=SilentDisplay)
    record: Record = field(default_factory=NoRecord)
    machine: Machine = field(default_factory=Machine)
    isolate: bool = False
    label: str = ""
    forced: frozenset[str] = frozenset()
    stop: threading.Event = field(default_factory=threading.Event)
    fresh: set[str] = field(default_factory=set)
    recipes: dict[ArtifactRef, Recipe] = field(default_factory=dict)
    held: dict[Path, Path] = field(default_factory=dict)
    listed: dict[Path, tuple[Path, ...]] = field(default_factory=dict)

    def perform(self, call: StageCall) -> ArtifactRef:
        """Have a stage call made."""
        self.recipes[call.recipe.ref] = call.recipe
        return self.performer(call, self)

    def recipe(self, ref: ArtifactRef) -> Recipe:
        """What an artifact is made of; a run in thought knows it before the artifact is there."""
        return self.recipes[ref] if ref in self.recipes else self.store.recipe(ref)

    def for_model(self, label: str, record: Record) -> Self:
        """The same session for one condition and seed."""
        return replace(self, label=label, record=record)

    def for_round(self, turn: int) -> Self:
        """The same session for one turn of collect, select, train."""
        label = f"{self.label.partition(ROUND)[0]}{ROUND}{turn}"
        return replace(self, label=label, record=self.record.for_round(turn))


Performer = Callable[[StageCall, Session], ArtifactRef]
