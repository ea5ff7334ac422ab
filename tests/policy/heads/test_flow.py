import pytest
import torch
from torch import nn

from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.heads.flow.config import FlowConfig
from juicer.policy.heads.flow.network import FULL_NOISE, FlowHead


class Oracle(nn.Module):
    """A denoiser that knows the clean chunk, and notes what it is shown and the time that it is told."""

    def __init__(self, clean):
        super().__init__()
        self.clean, self.shown, self.times = clean, [], []

    def forward(self, noisy, step, condition):
        self.shown.append(noisy)
        self.times.append(float(step[0]) / FULL_NOISE)
        return self.clean


def head_of(chunk=(8, 10), **settings):
    settings.setdefault("denoiser", MLPDenoiserConfig(width=32, blocks=1))
    return FlowHead(FlowConfig(**settings), chunk, {"state": (1, 5)})


def seen(rows):
    return {"state": rows[:, None]}


@pytest.mark.parametrize("steps", [1, 2, 4])
def test_a_perfect_denoiser_is_followed_straight_to_the_clean_chunk(steps):
    head = head_of(inference_steps=steps)
    clean, noise = torch.rand(4, 8, 10) * 1.6 - 0.8, torch.randn(4, 8, 10)
    head.denoiser = Oracle(clean)
    torch.testing.assert_close(head.sample(seen(torch.zeros(4, 5)), noise), clean)
    times = [left / steps for left in range(steps, 0, -1)]
    assert head.denoiser.times == times
    on_the_line = [time * noise + (1 - time) * clean for time in times]
    torch.testing.assert_close(torch.stack(head.denoiser.shown), torch.stack(on_the_line))


def test_samples_stay_within_the_training_range_and_depend_on_condition_and_noise_alone():
    head = head_of(inference_steps=2)
    condition, noise = seen(100 * torch.randn(4, 5)), torch.randn(4, 8, 10)
    sample = head.sample(condition, noise)
    assert sample.abs().max() <= 1
    assert torch.equal(sample, head.sample(condition, noise))


def test_many_steps_take_one_of_two_ways_and_a_single_one_their_mean():
    torch.manual_seed(0)
    head = head_of(denoiser=MLPDenoiserConfig(width=64, blocks=2), chunk=(2, 1))
    condition, noise = seen(torch.zeros(256, 5)), torch.randn(256, 2, 1)
    optimizer = torch.optim.AdamW(head.parameters(), lr=3e-3)
    for _ in range(200):
        either = 0.7 * torch.sign(torch.randn(256, 1, 1)).expand(256, 2, 1)
        optimizer.zero_grad()
        head.compute_loss(condition, either).mean().backward()
        optimizer.step()
    with torch.no_grad():
        mean = head.sample(condition, noise).mean((1, 2))
        head.config = head.config.model_copy(update={"inference_steps": 16})
        ways = head.sample(condition, noise).mean((1, 2))
    assert mean.abs().mean() < 0.2
    assert ways.abs().mean() > 0.5
    assert 0.25 < (ways > 0).float().mean() < 0.75


@pytest.mark.parametrize("denoiser", [MLPDenoiserConfig(width=16, blocks=1), UNetConfig(channels=(16, 16, 16))])
def test_every_weight_learns_in_bfloat16_and_the_loss_is_single_precision(denoiser):
    torch.manual_seed(0)
    head = head_of(denoiser=denoiser)
    with torch.autocast("cpu", torch.bfloat16):
        losses = head.compute_loss(seen(torch.randn(16, 5)), torch.rand(16, 8, 10) * 2 - 1)
    assert losses.dtype == torch.float32
    losses.mean().backward()
    assert all(weight.grad is not None and weight.grad.abs().sum() > 0 for weight in head.parameters())
