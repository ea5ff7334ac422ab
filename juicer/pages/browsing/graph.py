"""The graph around an artifact: all that it was made from, and all that was made from it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from juicer.artifacts.catalog import Contents
from juicer.artifacts.lineage import parents_first
from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError
from juicer.pages.addresses import lineage_of
from juicer.pages.browsing.previews import preview
from juicer.reporting.content import LineageNode
from juicer.reporting.lineage import Manifests, nodes_of
from juicer.reporting.lineage_drawing import Boxes, lineage_graph

MOST_ARTIFACTS = 150
"""Of a drawing; of more, those are shown that are the fewest steps away."""

Neighbours = Callable[[ArtifactRef], Iterable[ArtifactRef]]


@dataclass(frozen=True)
class Graph:
    """What is shown of a lineage.

    Attributes:
        drawing: SVG.
        nodes: The artifacts in it, parents first.
        left_out: How many more there are.
    """

    drawing: str
    nodes: Sequence[LineageNode]
    left_out: int


def graph_around(store: ArtifactStore, contents: Contents, ref: ArtifactRef) -> Graph:
    """The lineage of an artifact, in both directions."""
    entries, children = contents.by_ref, contents.children()

    def parents_of(each: ArtifactRef) -> Sequence[ArtifactRef]:
        return entries[each].parents if each in entries else ()

    distances = _distances(ref, lambda each: children.get(each, ()))
    distances |= _distances(ref, parents_of)
    nearest = sorted(distances, key=distances.__getitem__)[:MOST_ARTIFACTS]
    shown = set(nearest)
    order = parents_first(nearest, lambda each: [parent for parent in parents_of(each) if parent in shown])
    manifests = {each: _manifest(store, each) for each in order}
    nodes = [*nodes_of(manifests, {})]
    boxes = Boxes(link=lambda node: lineage_of(node.id), previews=_previews(store, manifests), chosen=str(ref))
    return Graph(lineage_graph(nodes, boxes, shrinks=False), nodes, len(distances) - len(nearest))


def _distances(ref: ArtifactRef, neighbours: Neighbours) -> dict[ArtifactRef, int]:
    """Steps to everything that can be reached in one direction."""
    distances = {ref: 0}
    waiting = [ref]
    for each in waiting:
        for other in neighbours(each):
            if other not in distances:
                distances[other] = distances[each] + 1
                waiting.append(other)
    return distances


def _manifest(store: ArtifactStore, ref: ArtifactRef) -> Manifest | None:
    try:
        return store.manifest(ref)
    except ArtifactError:
        return None


def _previews(store: ArtifactStore, manifests: Manifests) -> Mapping[str, str]:
    return {str(ref): preview(store, manifest) for ref, manifest in manifests.items() if manifest}
