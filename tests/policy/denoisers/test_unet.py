import torch

from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.denoisers.unet.network import UNetDenoiser

SMALL = UNetConfig(channels=(16, 32, 64), step_embedding=16)


def count(module):
    return sum(parameter.numel() for parameter in module.parameters())


def test_the_paper_network_has_the_original_number_of_parameters_in_every_part():
    with torch.device("meta"):
        network = UNetDenoiser(UNetConfig(), (32, 10), {"robot": (1, 16), "front": (1, 128), "wrist": (1, 128)})
    assert count(network) == 69_123_594
    assert count(network.step_encoder) == 525_568
    assert count(network.down) + count(network.downsample) == 29_390_336
    assert count(network.middle) == 23_150_592
    assert count(network.up) + count(network.upsample) == 15_726_080
    assert count(network.head) == 331_018


def test_the_shape_of_a_chunk_is_kept():
    network = UNetDenoiser(SMALL, (32, 10), {"state": (1, 7)})
    assert network(torch.randn(3, 32, 10), torch.tensor([0, 50, 99]), {"state": torch.randn(3, 1, 7)}).shape == (
        3,
        32,
        10,
    )


def test_condition_and_noise_level_both_matter():
    network = UNetDenoiser(SMALL, (32, 10), {"state": (1, 7)})
    noisy, condition, step = torch.randn(1, 32, 10), {"state": torch.randn(1, 1, 7)}, torch.tensor([5])
    output = network(noisy, step, condition)
    assert not torch.allclose(output, network(noisy, step, {"state": condition["state"] + 1}))
    assert not torch.allclose(output, network(noisy, step + 40, condition))
