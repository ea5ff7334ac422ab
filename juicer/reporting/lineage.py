"""Artifacts and everything they were made from, as nodes of a graph."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from juicer.artifacts.manifest import LABEL, Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError
from juicer.reporting.content import LineageNode


def lineage_nodes(store: ArtifactStore, refs: Sequence[ArtifactRef]) -> Iterator[LineageNode]:
    """Artifacts and everything they were made from, each once."""
    return nodes_of(read_lineage(store, refs))


def read_lineage(store: ArtifactStore, refs: Sequence[ArtifactRef]) -> dict[ArtifactRef, Manifest | None]:
    """Manifests of artifacts and of everything they were made from, parents before children; none where one is lost."""
    manifests: dict[ArtifactRef, Manifest | None] = {}
    waiting = list(refs)
    while waiting:
        ref = waiting.pop()
        if ref not in manifests:
            manifests[ref] = _read(store, ref)
            waiting += _parents(manifests, ref)
    return {ref: manifests[ref] for ref in ancestors_of(manifests, refs)}


def nodes_of(manifests: Mapping[ArtifactRef, Manifest | None]) -> Iterator[LineageNode]:
    """Artifacts as nodes of a graph, called by what they hold."""
    for ref, manifest in manifests.items():
        label = label_of(manifest) if manifest else "no longer there"
        yield LineageNode(str(ref), ref.kind, label, tuple(map(str, _parents(manifests, ref))))


def label_of(manifest: Manifest) -> str:
    """What an artifact is, in a few words."""
    return str(manifest.summary.get(LABEL, manifest.recipe.stage))


def checkpoint_of(evaluation: Manifest) -> ArtifactRef | None:
    """The checkpoint that was evaluated."""
    return next(iter(evaluation.recipe.inputs.get("checkpoint", ())), None)


def _read(store: ArtifactStore, ref: ArtifactRef) -> Manifest | None:
    try:
        return store.manifest(ref)
    except ArtifactError:
        return None


def _parents(manifests: Mapping[ArtifactRef, Manifest | None], ref: ArtifactRef) -> tuple[ArtifactRef, ...]:
    manifest = manifests[ref]
    return manifest.recipe.parents if manifest else ()


def ancestors_of(manifests: Mapping[ArtifactRef, Manifest | None], refs: Sequence[ArtifactRef]) -> list[ArtifactRef]:
    """Artifacts and all they were made from, parents first."""
    order: dict[ArtifactRef, None] = {}
    waiting = [(ref, False) for ref in reversed(refs)]
    while waiting:
        ref, has_parents = waiting.pop()
        if has_parents:
            order.setdefault(ref)
        elif ref not in order:
            waiting.append((ref, True))
            waiting += [(parent, False) for parent in reversed(_parents(manifests, ref))]
    return list(order)
