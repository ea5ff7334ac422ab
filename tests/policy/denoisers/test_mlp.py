import torch

from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
from juicer.policy.denoisers.mlp.network import MLPDenoiser


def test_condition_and_noise_level_both_matter():
    network = MLPDenoiser(MLPDenoiserConfig(width=32, blocks=2), (8, 10), {"state": (1, 7)})
    noisy, condition, step = torch.randn(1, 8, 10), {"state": torch.randn(1, 1, 7)}, torch.tensor([5])
    output = network(noisy, step, condition)
    assert output.shape == noisy.shape
    assert not torch.allclose(output, network(noisy, step, {"state": condition["state"] + 1}))
    assert not torch.allclose(output, network(noisy, step + 40, condition))
