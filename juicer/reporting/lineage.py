"""Draw artifacts and what they were made from: ancestors left, results right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from statistics import fmean

import numpy as np
from scipy.optimize import isotonic_regression

from juicer.reporting.content import LineageNode

_NODE_WIDTH, _NODE_HEIGHT, _COLUMN_GAP, _MARGIN = 136.0, 42.0, 20.0, 8.0
_NODE_SPACE, _BEND_SPACE = 58.0, 20.0
_LABEL_LETTERS = 18
_SWEEPS = 12

# A bend of an edge that passes through a column: (child, parent, column). Bends take part in the ordering.
_Bend = tuple[str, str, int]
_Item = str | _Bend


@dataclass(frozen=True)
class _Layout:
    columns: Mapping[str, int]
    places: Mapping[_Item, tuple[float, float]]
    width: float
    height: float


def lineage_graph(nodes: Sequence[LineageNode]) -> str:
    """Inline SVG of the graph; parents that are not among the nodes are left out.

    Returns:
        The drawing, or nothing if there are no nodes.
    """
    if not nodes:
        return ""
    known = {node.id: node for node in nodes}
    parents = {node.id: tuple(parent for parent in node.parents if parent in known) for node in nodes}
    layout = _lay_out(parents)
    edges = [_edge(child, parent, layout) for child in known for parent in parents[child]]
    boxes = [_box(node, *layout.places[node.id]) for node in nodes]
    return (
        f'<svg class="lineage" role="img" aria-label="Artifacts and their parents" '
        f'viewBox="0 0 {layout.width:.0f} {layout.height:.0f}" '
        f'style="max-width:{layout.width:.0f}px;min-width:{0.78 * layout.width:.0f}px">'
        f"{''.join(edges)}{''.join(boxes)}</svg>"
    )


def _lay_out(parents: Mapping[str, Sequence[str]]) -> _Layout:
    columns = _columns(parents)
    order, neighbours = _chains(parents, columns)
    _untangle(order, neighbours)
    heights = _heights(order, neighbours)
    top = min(heights.values()) - _NODE_HEIGHT / 2 - _MARGIN
    places = {
        item: (_MARGIN + index * (_NODE_WIDTH + _COLUMN_GAP), heights[item] - top)
        for index, column in enumerate(order)
        for item in column
    }
    return _Layout(
        columns=columns,
        places=places,
        width=2 * _MARGIN + len(order) * (_NODE_WIDTH + _COLUMN_GAP) - _COLUMN_GAP,
        height=max(heights.values()) - top + _NODE_HEIGHT / 2 + _MARGIN,
    )


def _columns(parents: Mapping[str, Sequence[str]]) -> dict[str, int]:
    """Column of each node: one further right than its rightmost parent."""
    columns: dict[str, int] = {}

    def column(node: str) -> int:
        if node not in columns:
            columns[node] = 1 + max((column(parent) for parent in parents[node]), default=-1)
        return columns[node]

    for node in parents:
        column(node)
    return columns


def _chains(
    parents: Mapping[str, Sequence[str]], columns: Mapping[str, int]
) -> tuple[list[list[_Item]], dict[_Item, list[_Item]]]:
    """Nodes and bends by column, and what each is joined to in the columns beside it."""
    order: list[list[_Item]] = [[] for _ in range(1 + max(columns.values()))]
    neighbours: dict[_Item, list[_Item]] = {node: [] for node in parents}
    for node, column in columns.items():
        order[column].append(node)
    for child, its_parents in parents.items():
        for parent in its_parents:
            chain: list[_Item] = [parent]
            for column in range(columns[parent] + 1, columns[child]):
                bend = (child, parent, column)
                order[column].append(bend)
                neighbours[bend] = []
                chain.append(bend)
            for left, right in pairwise([*chain, child]):
                neighbours[left].append(right)
                neighbours[right].append(left)
    return order, neighbours


def _untangle(order: list[list[_Item]], neighbours: Mapping[_Item, Sequence[_Item]]) -> None:
    """Sort each column by the mean height of its neighbours, sweeping right and left (barycentre heuristic)."""
    for sweep in range(_SWEEPS):
        for before, column in pairwise(order if sweep % 2 == 0 else order[::-1]):
            heights = {item: (row + 0.5) / len(before) for row, item in enumerate(before)}
            wanted = {
                item: fmean([heights[other] for other in neighbours[item] if other in heights] or [own / len(column)])
                for own, item in enumerate(column, start=1)
            }
            column.sort(key=wanted.__getitem__)


def _heights(order: Sequence[Sequence[_Item]], neighbours: Mapping[_Item, Sequence[_Item]]) -> dict[_Item, float]:
    """Centre of each item: as near its neighbours as the space between items of a column allows."""
    heights: dict[_Item, float] = {}
    spaces = {
        index: np.cumsum([0.0, *(_space(above, below) for above, below in pairwise(column))])
        for index, column in enumerate(order)
    }
    for index, column in enumerate(order):
        heights.update(zip(column, spaces[index] - spaces[index][-1] / 2, strict=True))
    for _ in range(_SWEEPS):
        for index, column in enumerate(order):
            wanted = [fmean(heights[other] for other in neighbours[item] or [item]) for item in column]
            # Straight bends are worth more than centred nodes: they make an edge easy to follow.
            weights = [1.0 if isinstance(item, str) else 3.0 for item in column]
            placed = isotonic_regression(np.array(wanted) - spaces[index], weights=weights).x + spaces[index]
            heights.update(zip(column, placed.tolist(), strict=True))
    return heights


def _space(above: _Item, below: _Item) -> float:
    return _NODE_SPACE / 2 * (isinstance(above, str) + isinstance(below, str)) + _BEND_SPACE / 2 * (
        isinstance(above, tuple) + isinstance(below, tuple)
    )


def _edge(child: str, parent: str, layout: _Layout) -> str:
    x, y = layout.places[parent]
    x += _NODE_WIDTH
    path = [f"M{x:.0f} {y:.1f}"]
    for column in range(layout.columns[parent] + 1, layout.columns[child] + 1):
        is_bend = column < layout.columns[child]
        to_x, to_y = layout.places[(child, parent, column) if is_bend else child]
        middle = (x + to_x) / 2
        path.append(f"C{middle:.0f} {y:.1f} {middle:.0f} {to_y:.1f} {to_x:.0f} {to_y:.1f}")
        x, y = to_x, to_y
        if is_bend:
            x += _NODE_WIDTH
            path.append(f"H{x:.0f}")
    return f'<path class="edge" d="{"".join(path)}"/>'


def _box(node: LineageNode, x: float, y: float) -> str:
    label = node.label if len(node.label) <= _LABEL_LETTERS else node.label[: _LABEL_LETTERS - 1] + "…"
    short_id = node.id.rpartition("/")[2][:6]
    return (
        f'<g class="node {escape(node.kind)}"><title>{escape(node.label)}: {escape(node.id)}</title>'
        f'<rect x="{x:.0f}" y="{y - _NODE_HEIGHT / 2:.1f}" width="{_NODE_WIDTH:.0f}" '
        f'height="{_NODE_HEIGHT:.0f}" rx="6"/>'
        f'<text x="{x + 9:.0f}" y="{y - 3:.1f}">{escape(label)}</text>'
        f'<text class="id" x="{x + 9:.0f}" y="{y + 12:.1f}">{escape(node.kind)} {escape(short_id)}</text></g>'
    )
