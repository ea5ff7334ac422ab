"""Artifacts and everything they were made from, as nodes of a graph."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

from juicer.artifacts.lineage import parents_first
from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError
from juicer.reporting.content import LineageNode

Manifests = Mapping[ArtifactRef, Manifest | None]
"""Manifests of artifacts and of everything they were made from, parents before children; None where one is lost."""


def read_lineage(store: ArtifactStore, refs: Sequence[ArtifactRef]) -> Manifests:
    """Manifests of artifacts and of everything they were made from."""
    manifests: dict[ArtifactRef, Manifest | None] = {}

    def parents_of(ref: ArtifactRef) -> tuple[ArtifactRef, ...]:
        manifests[ref] = _read(store, ref)
        return known_parents(manifests, ref)

    return {ref: manifests[ref] for ref in parents_first(refs, parents_of)}


def ancestors_of(manifests: Manifests, refs: Sequence[ArtifactRef]) -> list[ArtifactRef]:
    """Some of the artifacts and all they were made from, parents first."""
    return parents_first(refs, partial(known_parents, manifests))


def known_parents(manifests: Manifests, ref: ArtifactRef) -> tuple[ArtifactRef, ...]:
    """What an artifact was made from; nothing is known of one that is lost."""
    manifest = manifests[ref]
    return manifest.recipe.parents if manifest else ()


def nodes_of(manifests: Manifests, names: Mapping[ArtifactRef, str]) -> Iterator[LineageNode]:
    """Artifacts as nodes of a graph, called by their names, or if they have none by what they hold."""
    for ref, manifest in manifests.items():
        label = names.get(ref) or (manifest.label if manifest else "no longer there")
        yield LineageNode(str(ref), ref.kind, label, tuple(map(str, known_parents(manifests, ref))))


def checkpoint_of(evaluation: Manifest) -> ArtifactRef | None:
    """The checkpoint that was evaluated."""
    return next(iter(evaluation.recipe.inputs.get("checkpoint", ())), None)


def cpu_seconds_of(manifest: Manifest) -> float:
    """CPU time of making an artifact, or where it was not measured, wall time."""
    return manifest.seconds if manifest.cpu_seconds is None else manifest.cpu_seconds


def _read(store: ArtifactStore, ref: ArtifactRef) -> Manifest | None:
    try:
        return store.manifest(ref)
    except ArtifactError:
        return None
