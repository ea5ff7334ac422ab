"""Every row of the paper's Table VII: its encoder and its policy have as many weights as the original's."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import torch
import yaml

from juicer.config import parse_config
from juicer.policy.backbone import build_backbone
from juicer.policy.config import PolicyConfig, rough_parameters
from juicer.policy.network import PolicyNetwork
from juicer.policy.pretrained.known import KNOWN, ROWS

CHECKS = {
    "ResNet18, ImageNet": (11_176_512, 512, 91_607_946, 80_431_434),
    "ResNet18, from scratch": (11_176_512, 512, 91_607_946, 80_431_434),
    "ResNet34, ImageNet": (21_284_672, 512, 111_824_266, 90_539_594),
    "ResNet50, ImageNet": (23_508_032, 2048, 116_664_202, 93_156_170),
    "R3M, ResNet18": (11_176_512, 512, 91_607_946, 80_431_434),
    "R3M, ResNet34": (21_284_672, 512, 111_824_266, 90_539_594),
    "R3M, ResNet50": (23_508_032, 2048, 116_664_202, 93_156_170),
    "VIP, ResNet50": (25_606_208, 1024, 120_598_410, 94_992_202),
    "DINO, ViT-S/16": (21_665_664, 384, 112_553_482, 90_887_818),
    "MAE, ViT-B/16": (85_798_656, 768, 240_917_770, 155_119_114),
    "ResNet18, spatial softmax": (11_192_928, 64, 91_526_090, None),
    "EfficientNet-Lite0, ImageNet": (3_371_008, 1280, None, None),
}
"""Weights of the encoder, length of its features, weights of the policy with two trained encoders and with a frozen one
that both views share. Counted with torchvision and timm beside the original's U-Net."""
UNET = 69_123_594
"""Weights of the U-Net at a condition of 272 numbers: proprioception, and 128 of each image."""
NEVER_FROZEN = {"ResNet18, spatial softmax"}
"""Its maps are in no file, and are learned."""
ROW = {row.title: row for row in ROWS}


def policy_of(row, frozen):
    views = {camera: {"camera": camera, "width": 224, "height": 224} for camera in ("front", "wrist")}
    file = {"weights": {"file": "any.pth", "sha256": "0" * 64, "licence": "MIT"}} if frozen else {}
    images = {"kind": "images", "views": views, "backbone": {**row.backbone, **file}, "frozen": frozen}
    observation = {"proprioception": {"kind": "proprioception"}, "images": images}
    return parse_config({"observation": observation}, PolicyConfig, origin="test")


def parts_of(config, tasks):
    with torch.device("meta"):
        network = PolicyNetwork(config, tasks)
    return network.num_parameters, sum(each.numel() for each in network.head.parameters())


@pytest.mark.parametrize("title", CHECKS)
def test_an_encoder_has_as_many_weights_as_the_original(title):
    backbone_config = policy_of(ROW[title], frozen=False).observation["images"].backbone
    with torch.device("meta"):
        backbone = build_backbone(backbone_config, (224, 224))
    parameters = sum(each.numel() for each in backbone.parameters())
    assert (parameters, backbone_config.num_features) == CHECKS[title][:2]
    assert backbone_config.rough_parameters() == pytest.approx(parameters, rel=0.01)


@pytest.mark.parametrize(
    ("title", "frozen"),
    [(title, frozen) for title in CHECKS for frozen in (False, True) if not (frozen and title in NEVER_FROZEN)],
)
def test_a_policy_that_sees_has_as_many_weights_as_the_original(title, frozen, tasks):
    config = policy_of(ROW[title], frozen)
    parameters, head = parts_of(config, tasks)
    assert head == UNET
    assert CHECKS[title][2 + frozen] in (None, parameters)
    assert rough_parameters(config) == pytest.approx(parameters, rel=0.05)


def test_every_row_is_checked_and_every_file_belongs_to_a_row():
    assert {row.title for row in ROWS if row.is_in_paper} <= CHECKS.keys()
    assert {row.weights for row in ROWS} - {""} == KNOWN.keys()


def test_the_documentation_says_how_to_write_every_row():
    page = (Path(__file__).parents[2] / "docs" / "encoders.md").read_text()
    written = dict(re.findall(r"^\| ([^|`]+?) \| `(\{kind: .*\})` \|$", page, re.M))
    assert {title: yaml.safe_load(text) for title, text in written.items()} == {
        row.title: {**row.backbone, **({"weights": row.weights} if row.weights else {})} for row in ROWS
    }
