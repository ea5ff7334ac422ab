"""Draw artifacts and what they were made from: ancestors left and results right, or ancestors above results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import TopologicalSorter
from html import escape
from itertools import pairwise
from statistics import fmean

import numpy as np
from scipy.optimize import isotonic_regression

from juicer.reporting.content import LineageNode
from juicer.text import printable

_NODE_WIDTH, _NODE_HEIGHT, _LAYER_GAP, _NODE_GAP, _MARGIN = 136.0, 42.0, 20.0, 16.0, 8.0
_VERTICAL_LAYER_GAP = 30.0
PREVIEW_WIDTH, PREVIEW_HEIGHT = 118.0, 46.0
"""Of what may be drawn in a box below its words [SVG units]."""
_BEND_SPACE = 20.0
_MIN_SCALE = 0.78
"""How far a drawing shrinks before it scrolls: its letters stay legible."""

_LABEL_LETTERS = 18
_SWEEPS = 12

# A bend of an edge that passes through a layer: (child, parent, layer). Bends take part in the ordering.
_Bend = tuple[str, str, int]
_Item = str | _Bend
_Point = tuple[float, float]


@dataclass(frozen=True)
class Boxes:
    """What the boxes of a drawing are, beside their words.

    Attributes:
        link: Gives the address that a box leads to; none if it leads nowhere.
        previews: SVG of what some artifacts hold, by id, :data:`PREVIEW_WIDTH` times :data:`PREVIEW_HEIGHT`, from the
            origin; if there is any, all boxes have room for it.
        chosen: Id of the artifact that stands out; none if empty.
    """

    link: Callable[[LineageNode], str] | None = None
    previews: Mapping[str, str] = field(default_factory=dict)
    chosen: str = ""

    @property
    def height(self) -> float:
        """Of a box."""
        return _NODE_HEIGHT + (PREVIEW_HEIGHT + 8 if self.previews else 0)


@dataclass(frozen=True)
class _Layout:
    """Places of nodes and bends: how far along the direction in which results follow, and how far across it."""

    layers: Mapping[str, int]
    places: Mapping[_Item, _Point]
    is_vertical: bool
    length: float
    breadth: float
    node_height: float

    @property
    def thickness(self) -> float:
        """Of a node, along."""
        return self.node_height if self.is_vertical else _NODE_WIDTH

    def point(self, along: float, across: float) -> str:
        """Coordinates in the drawing."""
        x, y = (across, along) if self.is_vertical else (along, across)
        return f"{x:.1f} {y:.1f}"


def lineage_graph(
    nodes: Sequence[LineageNode], boxes: Boxes = Boxes(), *, is_vertical: bool = False, shrinks: bool = True
) -> str:
    """Inline SVG of the graph; parents that are not among the nodes are left out.

    Args:
        nodes: In any order.
        boxes: What they lead to and show.
        is_vertical: Whether ancestors stand above their results instead of left of them, for narrow pages.
        shrinks: Whether it takes less room where there is little, which takes a style of its own; else it has its size.

    Returns:
        The drawing, or nothing if there are no nodes.
    """
    if not nodes:
        return ""
    known = {node.id: node for node in nodes}
    parents = {node.id: tuple(parent for parent in node.parents if parent in known) for node in nodes}
    layout = _lay_out(parents, is_vertical, boxes.height)
    edges = [_edge(child, parent, layout) for child in known for parent in parents[child]]
    drawn = [_box(node, layout, boxes) for node in nodes]
    if boxes.link:
        drawn = [f'<a href="{escape(boxes.link(node))}">{box}</a>' for node, box in zip(nodes, drawn, strict=True)]
    width, height = (layout.breadth, layout.length) if is_vertical else (layout.length, layout.breadth)
    size = (
        f'style="max-width:{width:.0f}px;min-width:{_MIN_SCALE * width:.0f}px"'
        if shrinks
        else f'width="{width:.0f}" height="{height:.0f}"'
    )
    return (
        # What an image holds cannot be reached by those who do not see it, and links are to be.
        f'<svg class="lineage" role="{"group" if boxes.link else "img"}" aria-label="Artifacts and their parents" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" {size}>'
        f"{''.join(edges)}{''.join(drawn)}</svg>"
    )


def _lay_out(parents: Mapping[str, Sequence[str]], is_vertical: bool, node_height: float) -> _Layout:
    thickness, extent, gap = (
        (node_height, _NODE_WIDTH, _VERTICAL_LAYER_GAP) if is_vertical else (_NODE_WIDTH, node_height, _LAYER_GAP)
    )
    layers = _layers(parents)
    order, neighbours = _chains(parents, layers)
    _untangle(order, neighbours)
    across = _across(order, neighbours, extent + _NODE_GAP)
    nodes = [across[node] for node in parents]
    start = min(min(nodes) - extent / 2, min(across.values())) - _MARGIN
    end = max(max(nodes) + extent / 2, max(across.values())) + _MARGIN
    places = {
        item: (_MARGIN + index * (thickness + gap), across[item] - start)
        for index, layer in enumerate(order)
        for item in layer
    }
    length = 2 * _MARGIN + len(order) * (thickness + gap) - gap
    return _Layout(layers, places, is_vertical, length, end - start, node_height)


def _layers(parents: Mapping[str, Sequence[str]]) -> dict[str, int]:
    """Layer of each node: one further than its furthest parent."""
    layers: dict[str, int] = {}
    for node in TopologicalSorter(parents).static_order():
        layers[node] = 1 + max((layers[parent] for parent in parents[node]), default=-1)
    return layers


def _chains(
    parents: Mapping[str, Sequence[str]], layers: Mapping[str, int]
) -> tuple[list[list[_Item]], dict[_Item, list[_Item]]]:
    """Nodes and bends by layer, and what each is joined to in the layers beside it."""
    order: list[list[_Item]] = [[] for _ in range(1 + max(layers.values()))]
    neighbours: dict[_Item, list[_Item]] = {node: [] for node in parents}
    for node, layer in layers.items():
        order[layer].append(node)
    for child, its_parents in parents.items():
        for parent in its_parents:
            chain: list[_Item] = [parent]
            for layer in range(layers[parent] + 1, layers[child]):
                bend = (child, parent, layer)
                order[layer].append(bend)
                neighbours[bend] = []
                chain.append(bend)
            for before, after in pairwise([*chain, child]):
                neighbours[before].append(after)
                neighbours[after].append(before)
    return order, neighbours


def _untangle(order: list[list[_Item]], neighbours: Mapping[_Item, Sequence[_Item]]) -> None:
    """Sort each layer by the mean place of its neighbours, sweeping to and fro (barycentre heuristic)."""
    for sweep in range(_SWEEPS):
        for before, layer in pairwise(order if sweep % 2 == 0 else order[::-1]):
            places = {item: (row + 0.5) / len(before) for row, item in enumerate(before)}
            wanted = {
                item: fmean([places[other] for other in neighbours[item] if other in places] or [own / len(layer)])
                for own, item in enumerate(layer, start=1)
            }
            layer.sort(key=wanted.__getitem__)


def _across(
    order: Sequence[Sequence[_Item]], neighbours: Mapping[_Item, Sequence[_Item]], node_space: float
) -> dict[_Item, float]:
    """Centre of each item: as near its neighbours as the space between items of a layer allows."""

    def space(first: _Item, second: _Item) -> float:
        return sum(node_space if isinstance(item, str) else _BEND_SPACE for item in (first, second)) / 2

    places: dict[_Item, float] = {}
    spaces = [np.cumsum([0.0, *(space(first, second) for first, second in pairwise(layer))]) for layer in order]
    for layer, offsets in zip(order, spaces, strict=True):
        places.update(zip(layer, offsets - offsets[-1] / 2, strict=True))
    for _ in range(_SWEEPS):
        for layer, offsets in zip(order, spaces, strict=True):
            wanted = [fmean(places[other] for other in neighbours[item] or [item]) for item in layer]
            # Straight bends are worth more than centred nodes: they make an edge easy to follow.
            weights = [1.0 if isinstance(item, str) else 3.0 for item in layer]
            placed = isotonic_regression(np.array(wanted) - offsets, weights=weights).x + offsets
            places.update(zip(layer, placed.tolist(), strict=True))
    return places


def _edge(child: str, parent: str, layout: _Layout) -> str:
    along, across = layout.places[parent]
    along += layout.thickness
    path = [f"M{layout.point(along, across)}"]
    for layer in range(layout.layers[parent] + 1, layout.layers[child] + 1):
        is_bend = layer < layout.layers[child]
        to_along, to_across = layout.places[(child, parent, layer) if is_bend else child]
        middle = (along + to_along) / 2
        turns = ((middle, across), (middle, to_across), (to_along, to_across))
        path.append("C" + " ".join(layout.point(*turn) for turn in turns))
        along, across = to_along, to_across
        if is_bend:
            along += layout.thickness
            path.append(f"L{layout.point(along, across)}")
    return f'<path class="edge" d="{"".join(path)}"/>'


def _box(node: LineageNode, layout: _Layout, boxes: Boxes) -> str:
    along, across = layout.places[node.id]
    height = boxes.height
    x, y = (across - _NODE_WIDTH / 2, along) if layout.is_vertical else (along, across - height / 2)
    known = printable(node.label)
    label = known if len(known) <= _LABEL_LETTERS else known[: _LABEL_LETTERS - 1] + "…"
    kind, short_id = escape(node.kind), escape(node.id.rpartition("/")[2][:6])
    preview = boxes.previews.get(node.id, "")
    return (
        f'<g class="node {kind}{" chosen" if node.id == boxes.chosen else ""}">'
        f"<title>{escape(known)}: {escape(node.id)}</title>"
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{_NODE_WIDTH:.0f}" height="{height:.0f}" rx="6"/>'
        f'<text x="{x + 9:.1f}" y="{y + 18:.1f}">{escape(label)}</text>'
        f'<text class="id" x="{x + 9:.1f}" y="{y + 33:.1f}">{kind} {short_id}</text>'
        + (f'<g transform="translate({x + 9:.1f} {y + _NODE_HEIGHT:.1f})">{preview}</g>' if preview else "")
        + "</g>"
    )
