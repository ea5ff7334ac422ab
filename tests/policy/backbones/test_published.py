"""Our networks compute what those of torchvision and timm do, whose weights they are to be filled with."""

from __future__ import annotations

import pytest
import torch

from juicer.policy.backbone import build_backbone
from juicer.policy.members import BACKBONES
from tests.policy.backbones.fixed import fill, fixed_images

RECORDED = (
    # First three features of three images, by torchvision 0.28.0 and timm 1.0.31 with the same weights, torch 2.13 on a
    # CPU; ours differed by nothing at all.
    (
        "resnet",
        {"depth": 18, "norm": "batch"},
        (64, 96),
        [[0.19427, 0.50028, 0.90803], [0.04897, 0.514, 0.98], [0.15477, 0.24815, 1.06843]],
    ),
    (
        "resnet",
        {"depth": 18},
        (64, 96),
        [[0.08615, 1.09815, 1.84237], [0.10628, 0.82375, 2.07172], [0.10638, 1.06068, 1.92598]],
    ),
    (
        "resnet",
        {"depth": 34, "norm": "batch"},
        (64, 96),
        [[1.62186, 0.28469, 2.69956], [2.04884, 0.24567, 3.14525], [2.04053, 0.25115, 3.27107]],
    ),
    (
        "resnet",
        {"depth": 50, "norm": "batch", "outputs": 1024},
        (64, 96),
        [[1.44158, -1.72506, -1.88542], [1.71794, -1.90313, -2.03911], [1.78124, -1.77871, -1.93805]],
    ),
    (
        "vit",
        {"size": "small"},
        (48, 64),
        [[0.50807, -3.23886, -0.2307], [0.31452, -1.92685, -1.44687], [-0.03645, -1.16896, -0.73747]],
    ),
    (
        "efficientnet_lite",
        {},
        (64, 97),
        [[0.00418, 0.03461, 0.05785], [0.00417, 0.03419, 0.05691], [0.0046, 0.03328, 0.05921]],
    ),
)


@pytest.mark.parametrize(("kind", "settings", "size", "features"), RECORDED)
def test_features_are_those_of_the_published_networks(kind, settings, size, features):
    backbone = fill(build_backbone(BACKBONES.members[kind](**settings), size))
    with torch.no_grad():
        computed = backbone(fixed_images(*size))
    assert computed.shape == (3, backbone.config.num_features)
    torch.testing.assert_close(computed[:, :3], torch.tensor(features), atol=1e-4, rtol=0)


@pytest.mark.parametrize(
    ("settings", "entries", "some"),
    [
        ({"depth": 18, "norm": "batch"}, 120, ["bn1.running_var", "layer2.0.downsample.1.num_batches_tracked"]),
        ({"depth": 34, "norm": "batch"}, 216, ["layer3.5.conv2.weight"]),
        ({"depth": 50, "norm": "batch"}, 318, ["layer1.0.downsample.0.weight", "layer4.2.bn3.bias"]),
        ({"depth": 50, "norm": "batch", "outputs": 1024}, 320, ["fc.weight", "fc.bias"]),
        ({"depth": 18}, 60, ["bn1.weight", "layer4.1.bn2.bias"]),
    ],
)
def test_a_resnet_names_its_weights_as_torchvision_does(settings, entries, some):
    with torch.device("meta"):
        state = build_backbone(BACKBONES.members["resnet"](**settings), (224, 224)).state_dict()
    assert len(state) == entries
    assert set(some) <= state.keys()


@pytest.mark.parametrize(("size", "width"), [("small", 384), ("base", 768)])
def test_a_vit_names_its_weights_as_timm_does(size, width):
    with torch.device("meta"):
        state = build_backbone(BACKBONES.members["vit"](size=size), (224, 224)).state_dict()
    assert len(state) == 150
    assert state["pos_embed"].shape == (1, 197, width)
    assert {"cls_token", "patch_embed.proj.weight", "blocks.11.attn.qkv.bias", "blocks.0.mlp.fc2.bias"} <= state.keys()


@pytest.mark.parametrize(("channels", "groups"), [(64, 4), (512, 32), (2048, 128)])
def test_group_normalisation_has_a_group_for_every_sixteen_channels(channels, groups):
    with torch.device("meta"):
        network = build_backbone(BACKBONES.members["resnet"](depth=50), (224, 224))
    norms = [module for module in network.modules() if isinstance(module, torch.nn.GroupNorm)]
    assert {norm.num_groups for norm in norms if norm.num_channels == channels} == {groups}


def test_a_vit_takes_only_whole_patches():
    with pytest.raises(ValueError, match="a vit takes images whose sides are multiples of 16 pixels, not 96x100"):
        BACKBONES.members["vit"]().check_size(100, 96)


@pytest.mark.parametrize("kind", ["resnet", "efficientnet_lite"])
def test_statistics_stay_as_they_are_while_batches_are_small(kind):
    settings = {"norm": "batch"} if kind == "resnet" else {}
    backbone = fill(build_backbone(BACKBONES.members[kind](**settings), (32, 32)))
    before = {name: value.clone() for name, value in backbone.named_buffers()}
    acting = backbone(torch.zeros(3, 3, 32, 32))
    backbone.train()
    assert torch.equal(backbone(torch.zeros(3, 3, 32, 32)), acting)
    backbone(torch.zeros(63, 3, 32, 32))
    assert all(torch.equal(value, before[name]) for name, value in backbone.named_buffers())
    backbone(torch.zeros(64, 3, 32, 32))
    assert not any(torch.equal(value, before[name]) for name, value in backbone.named_buffers())
