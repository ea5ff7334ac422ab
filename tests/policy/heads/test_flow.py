import pytest
import torch
from pydantic import ValidationError
from torch import nn

from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.heads.flow.config import FlowConfig
from juicer.policy.heads.flow.network import FULL_NOISE, JUMP, FlowHead


class Oracle(nn.Module):
    """A denoiser that knows the clean chunk, and notes what it is told."""

    def __init__(self, clean):
        super().__init__()
        self.clean, self.told = clean, []

    def forward(self, noisy, step, condition):
        self.told.append((float(step[0]) / FULL_NOISE, int(condition[JUMP][0, 0].argmax())))
        return self.clean


def head_of(chunk=(8, 10), **settings):
    settings.setdefault("denoiser", MLPDenoiserConfig(width=32, blocks=1))
    return FlowHead(FlowConfig(**settings), chunk, {"state": (1, 5)})


def seen(rows):
    return {"state": rows[:, None]}


@pytest.mark.parametrize(
    ("steps", "told"),
    [
        (1, [(1.0, 3)]),
        (2, [(1.0, 2), (0.5, 2)]),
        (4, [(1.0, 1), (0.75, 1), (0.5, 1), (0.25, 1)]),
        (8, [(left / 8, 0) for left in range(8, 0, -1)]),
    ],
)
def test_a_perfect_denoiser_is_followed_to_the_clean_chunk_in_any_number_of_steps(steps, told):
    head = head_of(inference_steps=steps)
    clean = torch.rand(4, 8, 10) * 1.6 - 0.8
    head.denoiser = Oracle(clean)
    torch.testing.assert_close(head.sample(seen(torch.zeros(4, 5)), torch.randn(4, 8, 10)), clean)
    assert head.denoiser.told == told


def test_a_longer_jump_ends_where_two_of_half_its_length_do():
    torch.manual_seed(0)
    head = head_of()
    noisy, condition = torch.randn(3, 8, 10), seen(torch.randn(3, 5))
    level, start = torch.tensor([1, 2, 3]), torch.tensor([0.5, 0.75, 1.0])[:, None, None]
    half = torch.tensor([1, 2, 4])[:, None, None] / 8
    aim = head._aim_of_two(noisy, start.flatten(), level, condition)
    first = head._aim(noisy, start.flatten(), level - 1, condition).clamp(-1, 1)
    midway = noisy + (first - noisy) * half / start
    second = head._aim(midway, (start - half).flatten(), level - 1, condition).clamp(-1, 1)
    end = midway + (second - midway) * half / (start - half)
    torch.testing.assert_close(noisy + (aim - noisy) * 2 * half / start, end)
    assert not aim.requires_grad


def test_samples_stay_within_the_training_range_and_depend_on_condition_and_noise_alone():
    head = head_of(inference_steps=2)
    condition, noise = seen(100 * torch.randn(4, 5)), torch.randn(4, 8, 10)
    sample = head.sample(condition, noise)
    assert sample.abs().max() <= 1
    assert torch.equal(sample, head.sample(condition, noise))


def test_a_single_step_takes_one_of_two_ways_and_not_their_mean():
    torch.manual_seed(0)
    head = head_of(denoiser=MLPDenoiserConfig(width=64, blocks=2), chunk=(2, 1), longer_jumps=0.5)
    condition = seen(torch.zeros(256, 5))
    optimizer = torch.optim.AdamW(head.parameters(), lr=3e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, 600)
    for _ in range(600):
        either = 0.7 * torch.sign(torch.randn(256, 1, 1)).expand(256, 2, 1)
        optimizer.zero_grad()
        head.compute_loss(condition, either).mean().backward()
        optimizer.step()
        schedule.step()
    with torch.no_grad():
        ways = head.sample(condition, torch.randn(256, 2, 1)).mean((1, 2))
    assert ((ways.abs() - 0.7).abs() < 0.2).float().mean() > 0.75
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


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"inference_steps": 3}, "inference_steps must be a power of two, got 3"),
        ({"finest_steps": 12}, "finest_steps must be a power of two, got 12"),
        ({"inference_steps": 16}, "must not exceed finest_steps, got 16 > 8"),
    ],
)
def test_steps_that_no_jump_was_learned_for_are_refused(settings, sentence):
    with pytest.raises(ValidationError, match=sentence):
        FlowConfig(**settings)
