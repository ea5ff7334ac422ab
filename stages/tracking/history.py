"""What a model was made from, round by round, read from manifests."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.reporting.lineage import Manifests, checkpoint_of, known_parents, read_lineage


@dataclass(frozen=True)
class History:
    """An evaluated model and everything behind it.

    Attributes:
        evaluation: How it did.
        checkpoint: The model, the last of its line; none if it is lost.
        known: Manifests of the evaluation and of everything behind it.
        rounds: Where the facts of each belong: nowhere special for the final model and its data, below ``round_1/`` for
            the first model and what that made, and so on.
    """

    evaluation: Manifest
    checkpoint: ArtifactRef | None
    known: Manifests
    rounds: Mapping[ArtifactRef, str]

    @property
    def seconds(self) -> float:
        """What the model itself took, without the data that others use too."""
        return sum(
            manifest.seconds
            for ref, manifest in self.known.items()
            if manifest and (ref.kind in ("checkpoint", "evaluation") or _actor(self.known, ref))
        )


def read_history(store: ArtifactStore, evaluation: ArtifactRef) -> History:
    """Follow the parents of an evaluation.

    Raises:
        ArtifactError: If the evaluation is not there, or damaged.
    """
    manifest = store.manifest(evaluation)
    known = read_lineage(store, [evaluation])
    final = checkpoint_of(manifest)
    data = {ref: _data(known, ref) for ref in known if ref.kind == "checkpoint"}
    prefixes = _prefixes(known, data, final)
    rounds = {evaluation: ""}
    for model in sorted(data, key=lambda ref: ref != final):
        for ref in (model, *data[model]):
            rounds.setdefault(ref, prefixes[model])
    for ref in known:
        # What a model did belongs to its round, and so does what was chosen of it, or grown from it.
        if ref.kind != "evaluation" and (actor := _actor(known, ref)):
            rounds[ref] = prefixes[actor]
    return History(manifest, final, known, rounds)


def _prefixes(
    known: Manifests, data: Mapping[ArtifactRef, list[ArtifactRef]], final: ArtifactRef | None
) -> dict[ArtifactRef, str]:
    """Names of the rounds by model: one that learned from what two others did is the model of round 3."""
    turns = {ref: 1 + len({_actor(known, each) for each in data[ref]} - {None}) for ref in data if ref != final}
    alike = Counter(turns.values())
    prefixes = {ref: "" for ref in data}
    for ref, turn in turns.items():
        manifest = known[ref]
        # Models of several tasks are predecessors of one: each task has its own.
        tasks = "_".join(manifest.summary.get("tasks", ())) if manifest and alike[turn] > 1 else ""
        prefixes[ref] = f"round_{turn}/{tasks}/" if tasks else f"round_{turn}/"
    return prefixes


def _data(known: Manifests, model: ArtifactRef) -> list[ArtifactRef]:
    """Everything that a model learned from, as far as the models that made some of it."""
    found: dict[ArtifactRef, None] = {}
    waiting = list(known_parents(known, model))
    while waiting:
        ref = waiting.pop()
        if ref.kind != "checkpoint" and ref not in found:
            found[ref] = None
            waiting += known_parents(known, ref)
    return list(found)


def _actor(known: Manifests, ref: ArtifactRef) -> ArtifactRef | None:
    """The model that acted where an artifact was made, or in all that it was made of."""
    parents = known_parents(known, ref)
    behind = {_own_actor(known, parent) for parent in parents}
    return _own_actor(known, ref) or (behind.pop() if len(behind) == 1 else None)


def _own_actor(known: Manifests, ref: ArtifactRef) -> ArtifactRef | None:
    return next((parent for parent in known_parents(known, ref) if parent.kind == "checkpoint"), None)
