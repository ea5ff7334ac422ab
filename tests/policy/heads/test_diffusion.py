import math

import pytest
import torch
from pydantic import ValidationError
from torch import nn

from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
from juicer.policy.heads.diffusion.config import DiffusionConfig
from juicer.policy.heads.diffusion.network import DiffusionHead, sampling_steps, signal_levels


class Oracle(nn.Module):
    """A denoiser that knows the clean chunk."""

    def __init__(self, head, clean):
        super().__init__()
        self.head, self.clean = head, clean

    def forward(self, noisy, step, condition):
        if self.head.config.prediction == "sample":
            return self.clean
        signal, noise = self.head.signal_scale[step[0]], self.head.noise_scale[step[0]]
        return (noisy - signal * self.clean) / noise


def head_of(**settings):
    settings.setdefault("denoiser", MLPDenoiserConfig(width=32, blocks=1))
    return DiffusionHead(DiffusionConfig(**settings), (8, 10), {"state": (1, 5)})


def seen(rows):
    return {"state": rows[:, None]}


def test_the_schedule_is_the_squared_cosine():
    levels = signal_levels(100)
    expected = math.cos((0.5 + 0.008) / 1.008 * math.pi / 2) ** 2 / math.cos(0.008 / 1.008 * math.pi / 2) ** 2
    assert float(levels[49]) == pytest.approx(expected, rel=1e-9)
    assert float(levels[84]) == pytest.approx(0.054, abs=1e-3)
    assert float(levels[99]) < 1e-4
    assert torch.all(levels[1:] < levels[:-1])


def test_the_sampler_visits_the_original_noise_levels_with_leading_spacing():
    assert sampling_steps(DiffusionConfig(inference_steps=8)) == [84, 72, 60, 48, 36, 24, 12, 0]
    assert sampling_steps(DiffusionConfig(inference_steps=16))[:2] == [90, 84]


def test_the_sampler_starts_at_full_noise_with_trailing_spacing():
    steps = sampling_steps(DiffusionConfig(inference_steps=8, spacing="trailing"))
    assert steps[0] == 99
    assert len(steps) == 8
    assert steps == sorted(set(steps), reverse=True)


@pytest.mark.parametrize("prediction", ["epsilon", "sample"])
@pytest.mark.parametrize("spacing", ["leading", "trailing"])
def test_a_perfect_denoiser_is_followed_to_the_clean_chunk(prediction, spacing):
    head = head_of(prediction=prediction, spacing=spacing)
    clean = torch.rand(4, 8, 10) * 1.6 - 0.8
    head.denoiser = Oracle(head, clean)
    torch.testing.assert_close(head.sample(seen(torch.zeros(4, 5)), torch.randn(4, 8, 10)), clean, atol=1e-4, rtol=1e-4)


def test_samples_stay_within_the_training_range():
    sample = head_of(prediction="sample").sample(seen(100 * torch.randn(4, 5)), torch.randn(4, 8, 10))
    assert sample.abs().max() <= 1


def trained(head, condition, chunk, num_steps):
    optimizer = torch.optim.AdamW(head.parameters(), lr=3e-3)
    for _ in range(num_steps):
        optimizer.zero_grad()
        loss = head.compute_loss(seen(condition), chunk).mean()
        loss.backward()
        optimizer.step()
    return loss.item()


def test_training_makes_samples_resemble_the_data():
    torch.manual_seed(0)
    head = head_of(prediction="sample", denoiser=MLPDenoiserConfig(width=64, blocks=2))
    condition = torch.sign(torch.randn(64, 5))
    chunk = 0.5 * condition[:, :1, None].expand(64, 8, 10)
    trained(head, condition, chunk, num_steps=100)
    with torch.no_grad():
        sample = head.sample(seen(condition), torch.randn_like(chunk))
    assert (sample - chunk).abs().mean() < 0.15


def test_training_teaches_the_noise():
    torch.manual_seed(0)
    head = head_of(prediction="epsilon", denoiser=MLPDenoiserConfig(width=256, blocks=1))
    condition = torch.sign(torch.randn(64, 5))
    chunk = 0.5 * condition[:, :1, None].expand(64, 8, 10)
    assert trained(head, condition, chunk, num_steps=60) < 0.3


def test_more_sampling_than_training_steps_are_refused():
    with pytest.raises(ValidationError, match="must not exceed train_timesteps"):
        DiffusionConfig(train_timesteps=4, inference_steps=8)
