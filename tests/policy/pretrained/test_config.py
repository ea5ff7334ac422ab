"""What a configuration may say of weights."""

from __future__ import annotations

import pytest

from juicer.config import parse_config
from juicer.errors import ConfigError
from juicer.policy.backbones.resnet.config import ResNetConfig
from juicer.policy.pretrained.config import Weights
from juicer.policy.pretrained.known import KNOWN


def resnet(weights):
    return parse_config({"weights": weights}, ResNetConfig, origin="test")


def test_a_name_stands_for_a_file_with_its_digest_and_licence():
    config = resnet("resnet18_imagenet")
    assert config.weights.sha256 == "f37072fd47e89c5e827621c5baffa7500819f7896bbacec160b1a16c560e07ec"
    assert config.weights.file == "resnet18-f37072fd.pth"
    assert config == ResNetConfig.model_validate(config.model_dump(mode="json"))
    assert config.weights.model_dump().keys() == {"file", "sha256", "licence", "part"}


@pytest.mark.parametrize(
    ("weights", "sentence"),
    [
        ("resnet18_imagnet", "weights: there are no weights of this name; did you mean 'resnet18_imagenet'"),
        (
            "r3m_18",
            r"weights: nobody has published the digest of 'r3m_18\.pt': get it once by `load_r3m\('resnet18'\)` of "
            r"the package at https://github.com/facebookresearch/r3m, see what `juicer doctor --encoders` says of it, "
            r"and write weights: "
            r"{file: r3m_18\.pt, sha256: THAT, licence: MIT}",
        ),
        ({"file": "../x.pth", "sha256": "0" * 64, "licence": "MIT"}, r"weights\.file: must match"),
        ({"file": "/etc/passwd", "sha256": "0" * 64, "licence": "MIT"}, r"weights\.file: must match"),
        ({"file": "x.pth", "sha256": "abc", "licence": "MIT"}, r"weights\.sha256: must match"),
        ({"file": "x.pth", "sha256": "0" * 64}, r"weights\.licence is missing|weights\.licence: is missing"),
        (7, "weights: must hold keys and values"),
    ],
)
def test_what_is_no_file_with_a_digest_is_refused_in_a_sentence(weights, sentence):
    with pytest.raises(ConfigError, match=sentence):
        resnet(weights)


def test_licences_that_allow_no_commercial_use_are_known():
    barred = {
        name
        for name, known in KNOWN.items()
        if not Weights(file="x", sha256="0" * 64, licence=known.licence).is_commercial
    }
    assert barred == {"vip", "mae_vitb16"}
