"""The paper's own results, to show beside ours."""

from __future__ import annotations

from collections.abc import Mapping

PAPER_TABLE_VI: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "one_leg": {
        "BC": (0.59, 0.68),
        "State noise": (0.64, 0.7),
        "TA": (0.64, 0.65),
        "CI": (0.75, 0.79),
        "TA+CI": (0.74, 0.85),
        "Multi-task": (0.58, 0.67),
        "MLP-C": (0.4, 0.52),
        "MLP-NC": (0.0, 0.0),
    },
    "round_table": {
        "BC": (0.18, 0.21),
        "State noise": (0.12, 0.19),
        "TA": (0.28, 0.31),
        "CI": (0.24, 0.27),
        "TA+CI": (0.32, 0.35),
        "Multi-task": (0.25, 0.34),
        "MLP-C": (0.09, 0.15),
        "MLP-NC": (0.0, 0.0),
    },
    "lamp": {
        "BC": (0.06, 0.07),
        "State noise": (0.06, 0.11),
        "TA": (0.08, 0.12),
        "CI": (0.18, 0.29),
        "TA+CI": (0.28, 0.3),
        "Multi-task": (0.12, 0.18),
        "MLP-C": (0.03, 0.04),
        "MLP-NC": (0.0, 0.0),
    },
    "square_table": {
        "BC": (0.06, 0.09),
        "State noise": (0.13, 0.16),
        "TA": (0.09, 0.17),
        "CI": (0.12, 0.2),
        "TA+CI": (0.15, 0.17),
        "Multi-task": (0.07, 0.1),
        "MLP-C": (0.04, 0.09),
        "MLP-NC": (0.0, 0.0),
    },
}
"""Average and best success rate of five image-based models, by task and condition (paper, Table VI)."""
