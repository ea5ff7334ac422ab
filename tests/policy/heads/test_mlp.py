import pytest
import torch

from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.policy.heads.mlp.network import MLPHead

SEEN = {"state": (1, 5), "task": (1, 2)}


def condition_of(num_rows):
    return {name: torch.randn(num_rows, *size) for name, size in SEEN.items()}


@pytest.mark.parametrize(("pred_horizon", "expected"), [(32, 11_103_552), (1, 10_785_802)])
def test_the_paper_baselines_have_the_original_number_of_parameters(pred_horizon, expected):
    with torch.device("meta"):
        head = MLPHead(MLPHeadConfig(), (pred_horizon, 10), {"robot": (1, 16), "front": (1, 128), "wrist": (1, 128)})
    assert sum(parameter.numel() for parameter in head.parameters()) == expected


def test_the_prediction_ignores_the_noise():
    head = MLPHead(MLPHeadConfig(width=16, blocks=1), (4, 10), SEEN).eval()
    condition = condition_of(2)
    assert torch.equal(head.sample(condition, torch.zeros(2, 4, 10)), head.sample(condition, torch.ones(2, 4, 10)))


def test_the_loss_is_the_squared_error_of_every_entry():
    head = MLPHead(MLPHeadConfig(width=16, blocks=1, dropout=0.0), (4, 10), SEEN)
    condition, chunk = condition_of(2), torch.randn(2, 4, 10)
    assert torch.equal(head.compute_loss(condition, chunk), (head(condition) - chunk) ** 2)
