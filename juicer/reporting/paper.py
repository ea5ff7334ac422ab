"""The paper's own results, to show beside ours."""

from __future__ import annotations

from collections.abc import Mapping

PAPER_TABLE_VI: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "one_leg": {
        "bc": (0.59, 0.68),
        "state_noise": (0.64, 0.7),
        "ta": (0.64, 0.65),
        "ci": (0.75, 0.79),
        "ta_ci": (0.74, 0.85),
        "multitask": (0.58, 0.67),
        "mlp_chunked": (0.4, 0.52),
        "mlp_unchunked": (0.0, 0.0),
    },
    "round_table": {
        "bc": (0.18, 0.21),
        "state_noise": (0.12, 0.19),
        "ta": (0.28, 0.31),
        "ci": (0.24, 0.27),
        "ta_ci": (0.32, 0.35),
        "multitask": (0.25, 0.34),
        "mlp_chunked": (0.09, 0.15),
        "mlp_unchunked": (0.0, 0.0),
    },
    "lamp": {
        "bc": (0.06, 0.07),
        "state_noise": (0.06, 0.11),
        "ta": (0.08, 0.12),
        "ci": (0.18, 0.29),
        "ta_ci": (0.28, 0.3),
        "multitask": (0.12, 0.18),
        "mlp_chunked": (0.03, 0.04),
        "mlp_unchunked": (0.0, 0.0),
    },
    "square_table": {
        "bc": (0.06, 0.09),
        "state_noise": (0.13, 0.16),
        "ta": (0.09, 0.17),
        "ci": (0.12, 0.2),
        "ta_ci": (0.15, 0.17),
        "multitask": (0.07, 0.1),
        "mlp_chunked": (0.04, 0.09),
        "mlp_unchunked": (0.0, 0.0),
    },
}
"""Average and best success rate of five image-based models, by task and name of the condition (paper, Table VI)."""
