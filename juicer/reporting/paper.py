"""The paper's own results, to show beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

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

PAPER_TABLE_VII: Mapping[str, float] = {
    "resnet18_imagenet": 0.59,
    "resnet18_scratch": 0.49,
    "spatial_softmax": 0.30,
    "dino": 0.55,
    "mae": 0.63,
    "r3m_18": 0.77,
    "r3m_34": 0.75,
    "r3m_50": 0.73,
    "vip": 0.54,
}
"""Average success rate of BC on one_leg by encoder of images (paper, Table VII), which is the name of a condition."""


def paper_figures(task: str) -> Mapping[str, tuple[float, ...]]:
    """Success rates by name of the condition, as the paper's Tables VI (average, best) and VII (average) have them."""
    encoders = {name: (average,) for name, average in PAPER_TABLE_VII.items()} if task == "one_leg" else {}
    return {**encoders, **PAPER_TABLE_VI.get(task, {})}


@dataclass(frozen=True)
class PaperEffort:
    """What fifty demonstrations of a task cost people (paper, Table IV; length from Table V).

    Attributes:
        collecting_min: Minutes of recording them.
        annotating_min: Minutes of marking their critical states, most of it loading and saving files.
        critical_states: Critical states of a demonstration.
        steps: Mean length of a demonstration.
    """

    collecting_min: int
    annotating_min: int
    critical_states: int
    steps: int


PAPER_TABLE_IV: Mapping[str, PaperEffort] = {
    "one_leg": PaperEffort(70, 10, 1, 580),
    "round_table": PaperEffort(85, 20, 3, 940),
    "lamp": PaperEffort(95, 30, 5, 840),
    "square_table": PaperEffort(210, 30, 4, 2600),
}

PAPER_TABLE_V: Mapping[str, Mapping[str, tuple[int, int, int]]] = {
    "one_leg": {"bc": (50, 0, 0), "ta": (50, 0, 50), "ci": (50, 50, 0), "ta_ci": (50, 50, 150)},
    "round_table": {"bc": (50, 0, 0), "ta": (50, 0, 500), "ci": (50, 50, 0), "ta_ci": (50, 50, 700)},
    "lamp": {"bc": (50, 0, 0), "ta": (50, 0, 100), "ci": (50, 50, 0), "ta_ci": (50, 50, 200)},
    "square_table": {"bc": (50, 0, 0), "ta": (50, 0, 150), "ci": (50, 50, 0), "ta_ci": (50, 50, 400)},
}
"""Episodes learned from, by task and condition: demonstrations, rollouts, snippets (paper, Table V)."""

PAPER_CURVES: Mapping[str, Mapping[str, Mapping[float, float]]] = {
    "one_leg": {
        "demonstrations": {10: 0.206, 20: 0.356, 30: 0.446, 40: 0.538},
        "own_rollouts": {50: 0.528, 100: 0.71, 200: 0.703, 300: 0.767, 500: 0.775, 1000: 0.74},
    },
}
"""Average success rates by task and name of the curve (paper, Figure 3, from its released table)."""

PAPER_CURVES_ARE = (
    "Up to 40 these are demonstrations; 50 are 25 demonstrations and 25 rollouts, and from 100 on it is 50 "
    "demonstrations and the rest rollouts of policies. 300 rests on two models, the others on five or six."
)
"""What the paper's axis, which says demonstrations, counts."""
