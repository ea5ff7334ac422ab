"""How gradients become weights: what any training shares with others."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from juicer.training.optimisation import Optimisation, Schedule


def test_the_learning_rate_rises_linearly_and_falls_to_zero_like_a_cosine():
    schedule = Schedule(peak=1.0, warmup_steps=5, steps=105)
    assert schedule.rate(0) == pytest.approx(0.2)
    assert schedule.rate(4) == pytest.approx(1.0)
    assert schedule.rate(55) == pytest.approx(0.5)
    assert schedule.rate(104) < 1e-3


def test_any_network_continues_bit_for_bit_from_its_tensors():
    def made():
        torch.manual_seed(0)
        return Optimisation(nn.Linear(3, 2), Schedule(0.1, 2, 20), weight_decay=0.01, average_decay=0.9)

    def learn(optimisation, step):
        torch.manual_seed(step)
        optimisation.forget_gradients()
        optimisation.network(torch.randn(4, 3)).square().mean().backward()
        optimisation.step(step)

    whole, resumed = made(), made()
    for step in range(6):
        learn(whole, step)
    resumed.restore({name: value.clone() for name, value in whole.tensors().items()}, 6)
    for step in range(6, 10):
        learn(whole, step)
        learn(resumed, step)
    for name, value in whole.tensors().items():
        assert torch.equal(resumed.tensors()[name], value), name
    assert resumed.acting is resumed.average


@pytest.mark.parametrize("weights_lie", [torch.contiguous_format, torch.channels_last])
@pytest.mark.parametrize("gradients_lie", [torch.contiguous_format, torch.channels_last])
def test_how_weights_and_gradients_lie_in_memory_changes_nothing(weights_lie, gradients_lie):
    def moved(weights_lie, gradients_lie):
        torch.manual_seed(0)
        network = nn.Conv2d(3, 4, 3).to(memory_format=weights_lie)
        optimisation = Optimisation(network, Schedule(0.1, 1, 20), weight_decay=0.01, average_decay=None)
        for step in range(3):
            network.bias.grad = torch.ones(4)
            network.weight.grad = torch.randn(4, 3, 3, 3).contiguous(memory_format=gradients_lie)
            optimisation.step(step)
        return network.weight

    torch.testing.assert_close(
        moved(weights_lie, gradients_lie), moved(torch.contiguous_format, torch.contiguous_format)
    )
