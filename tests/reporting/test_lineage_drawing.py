"""Claims about the drawn graph."""

from __future__ import annotations

import re
from itertools import combinations

import pytest

from juicer.reporting.content import LineageNode, ReportData
from juicer.reporting.lineage_drawing import lineage_graph

BOX = re.compile(r'<rect x="([0-9.]+)" y="([0-9.]+)" width="([0-9.]+)" height="([0-9.]+)"')


def test_every_artifact_has_a_box_and_every_parent_an_edge(report_data: ReportData):
    drawing = lineage_graph(report_data.lineage)
    assert len(BOX.findall(drawing)) == len(report_data.lineage)
    assert drawing.count('class="edge"') == sum(len(node.parents) for node in report_data.lineage)


@pytest.mark.parametrize("is_vertical", [False, True])
def test_boxes_stay_apart_and_inside_the_drawing(report_data: ReportData, is_vertical: bool):
    drawing = lineage_graph(report_data.lineage, is_vertical=is_vertical)
    boxes = [tuple(float(value) for value in box) for box in BOX.findall(drawing)]
    for (x, y, width, height), (other_x, other_y, _, _) in combinations(boxes, 2):
        assert abs(x - other_x) >= width or abs(y - other_y) >= height
    (size,) = re.findall(r'viewBox="0 0 ([0-9]+) ([0-9]+)"', drawing)
    assert max(x + width for x, _, width, _ in boxes) <= float(size[0])
    assert max(y + height for _, y, _, height in boxes) <= float(size[1])
    assert min(min(x, y) for x, y, _, _ in boxes) >= 0


def test_children_stand_right_of_their_parents():
    nodes = (
        LineageNode("evaluation/3", "evaluation", "rate", ("checkpoint/2",)),
        LineageNode("checkpoint/2", "checkpoint", "policy", ("episodes/1",)),
        LineageNode("episodes/1", "episodes", "demonstrations"),
    )
    left = [float(x) for x, *_ in BOX.findall(lineage_graph(nodes))]
    assert left == sorted(left, reverse=True)


def test_children_stand_below_their_parents_on_a_narrow_page():
    nodes = (
        LineageNode("evaluation/3", "evaluation", "rate", ("checkpoint/2",)),
        LineageNode("checkpoint/2", "checkpoint", "policy", ("episodes/1",)),
        LineageNode("episodes/1", "episodes", "demonstrations"),
    )
    tops = [float(y) for _, y, *_ in BOX.findall(lineage_graph(nodes, is_vertical=True))]
    assert tops == sorted(tops, reverse=True)


def test_a_long_chain_is_no_harder_than_a_short_one():
    nodes = [LineageNode(f"episodes/{n}", "episodes", str(n), (f"episodes/{n - 1}",)) for n in range(1, 2000)]
    assert len(BOX.findall(lineage_graph(nodes))) == 1999


def test_parents_that_are_not_shown_are_left_out():
    node = LineageNode("checkpoint/2", "checkpoint", "policy", ("episodes/elsewhere",))
    assert 'class="edge"' not in lineage_graph((node,))


def test_no_artifacts_give_no_drawing():
    assert lineage_graph(()) == ""


def test_labels_are_escaped():
    assert "<b>" not in lineage_graph((LineageNode("episodes/1", "episodes", "<b>"),))
