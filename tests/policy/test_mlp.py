import pytest
import torch

from juicer.policy.config import MLPConfig
from juicer.policy.mlp import MLPHead


@pytest.mark.parametrize(("pred_horizon", "expected"), [(32, 11_103_552), (1, 10_785_802)])
def test_the_paper_baselines_have_the_original_number_of_parameters(pred_horizon, expected):
    with torch.device("meta"):
        head = MLPHead(pred_horizon, action_size=10, condition_size=272, config=MLPConfig())
    assert sum(parameter.numel() for parameter in head.parameters()) == expected


def test_the_prediction_ignores_the_noise():
    head = MLPHead(4, 10, 7, MLPConfig(width=16, blocks=1)).eval()
    condition = torch.randn(2, 7)
    assert torch.equal(head.sample(condition, torch.zeros(2, 4, 10)), head.sample(condition, torch.ones(2, 4, 10)))


def test_the_loss_is_the_squared_error_of_every_entry():
    head = MLPHead(4, 10, 7, MLPConfig(width=16, blocks=1, dropout=0.0))
    condition, chunk = torch.randn(2, 7), torch.randn(2, 4, 10)
    assert torch.equal(head.compute_loss(condition, chunk), (head(condition) - chunk) ** 2)
