import torch

from juicer.policy.config import MLPDenoiserConfig
from juicer.policy.mlp_denoiser import MLPDenoiser


def test_condition_and_noise_level_both_matter():
    network = MLPDenoiser(8, 10, 7, MLPDenoiserConfig(width=32, blocks=2))
    noisy, condition, step = torch.randn(1, 8, 10), torch.randn(1, 7), torch.tensor([5])
    output = network(noisy, step, condition)
    assert output.shape == noisy.shape
    assert not torch.allclose(output, network(noisy, step, condition + 1))
    assert not torch.allclose(output, network(noisy, step + 40, condition))
