"""The conditions of a study: which parts of the method each of them uses (paper, Table VI), and open-loop replay."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Condition(StrEnum):
    """Name of a condition in configuration files."""

    REPLAY = "replay"
    BC = "bc"
    STATE_NOISE = "state_noise"
    TA = "ta"
    CI = "ci"
    TA_CI = "ta_ci"
    MLP_CHUNKED = "mlp_chunked"
    MLP_UNCHUNKED = "mlp_unchunked"
    MULTITASK = "multitask"


@dataclass(frozen=True)
class Method:
    """What a condition is made of.

    Attributes:
        title: As the paper writes it.
        augments: Whether corrective episodes are added.
        collects: Whether it retrains on its own successes.
        adds_noise: Whether observed states are perturbed in training.
        policy: Which entry of a configuration's section ``train`` it trains.
        replays: Whether it plays demonstrations instead of training on them.
        mixes: Whether one model is trained on the data of several tasks.
    """

    title: str
    augments: bool = False
    collects: bool = False
    adds_noise: bool = False
    policy: str = "diffusion"
    replays: bool = False
    mixes: bool = False


METHODS = {
    Condition.REPLAY: Method("Replay", replays=True),
    Condition.BC: Method("BC"),
    Condition.STATE_NOISE: Method("State noise", adds_noise=True),
    Condition.TA: Method("TA", augments=True),
    Condition.CI: Method("CI", collects=True),
    Condition.TA_CI: Method("TA+CI", augments=True, collects=True),
    Condition.MLP_CHUNKED: Method("MLP-C", policy="mlp_chunked"),
    Condition.MLP_UNCHUNKED: Method("MLP-NC", policy="mlp_unchunked"),
    Condition.MULTITASK: Method("Multi-task", augments=True, collects=True, mixes=True),
}
