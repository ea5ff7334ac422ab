"""What several processes share of one training."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from juicer.errors import ConfigError
from juicer.policy.backbone import SMALLEST_BATCH, BatchNorm, build_backbone
from juicer.policy.backbones.efficientnet_lite.config import EfficientNetLiteConfig
from juicer.training.ranks import share_statistics

CPU, GPU = torch.device("cpu"), torch.device("cuda")


def layers_of(network, kind):
    return [each for each in network.modules() if isinstance(each, kind)]


@pytest.mark.parametrize("device", [CPU, GPU], ids=str)
def test_statistics_that_stay_as_they_are_in_small_batches_do_so_on_several_devices(device):
    network = build_backbone(EfficientNetLiteConfig(), (32, 32))
    number = len(layers_of(network, BatchNorm))
    share_statistics(network, device, SMALLEST_BATCH - 1)
    assert len(layers_of(network, BatchNorm)) == number
    before = {name: value.clone() for name, value in network.named_buffers()}
    network(torch.rand(8, 3, 32, 32))
    assert all(torch.equal(value, before[name]) for name, value in network.named_buffers())


def test_statistics_of_large_batches_are_those_of_the_whole_batch():
    network = build_backbone(EfficientNetLiteConfig(), (32, 32))
    names = list(network.state_dict())
    number = len(layers_of(network, BatchNorm))
    share_statistics(network, GPU, SMALLEST_BATCH)
    assert len(layers_of(network, nn.SyncBatchNorm)) == number
    assert not layers_of(network, BatchNorm)
    assert list(network.state_dict()) == names


def test_processors_cannot_share_statistics_and_say_so_only_if_some_are_taken():
    network = build_backbone(EfficientNetLiteConfig(), (32, 32))
    with pytest.raises(ConfigError, match=r"^batch normalisation needs the whole batch.* JUICER_TRAIN_PROCESSES=1"):
        share_statistics(network, CPU, SMALLEST_BATCH)
    share_statistics(network.eval(), CPU, SMALLEST_BATCH)
    with pytest.raises(ConfigError, match="batch normalisation needs the whole batch"):
        share_statistics(nn.Sequential(nn.BatchNorm2d(3)), CPU, 2)
