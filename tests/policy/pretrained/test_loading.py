"""Weights from files into networks."""

from __future__ import annotations

import io
import logging
import pickle
import zipfile
from pathlib import Path

import pytest
import torch
from safetensors.torch import save

from juicer.errors import UnusableWeights
from juicer.policy.backbone import build_backbone
from juicer.policy.backbones.patch_cnn.config import PatchCNNConfig
from juicer.policy.backbones.resnet.config import ResNetConfig
from juicer.policy.backbones.vit.config import ViTConfig
from juicer.policy.pretrained.loading import Pretrained, load_pretrained
from tests.policy.backbones.fixed import fixed_weights


class Bomb:
    def __init__(self, target):
        self.target = target

    def __reduce__(self):
        return Path.touch, (self.target,)


def torchvision_state(depth=18, classes=1000):
    """What a file of torchvision holds: batch normalisation and a classifier."""
    with torch.device("meta"):
        shapes = {
            name: value.shape
            for name, value in build_backbone(ResNetConfig(depth=depth, norm="batch"), (64, 64)).state_dict().items()
        }
    last = 512 if depth < 50 else 2048
    return fixed_weights({**shapes, "fc.weight": torch.Size([classes, last]), "fc.bias": torch.Size([classes])})


def filled(config, weights, folder, size=(64, 64)):
    backbone = build_backbone(config.model_copy(update={"weights": weights}), size)
    before = {name: value.clone() for name, value in backbone.state_dict().items()}
    assert load_pretrained(torch.nn.Sequential(backbone), folder) == (Pretrained(weights, False),)
    return before, backbone.state_dict()


def test_a_file_of_torchvision_fills_a_resnet_but_for_the_classifier(store, folder):
    state = torchvision_state()
    _, loaded = filled(ResNetConfig(norm="batch"), store(state), folder)
    assert len(state) == 122
    assert all(torch.equal(value, state[name]) for name, value in loaded.items())


def test_group_normalisation_takes_convolutions_only_as_in_the_original(store, folder):
    state = torchvision_state()
    before, loaded = filled(ResNetConfig(), store(state), folder)
    norms = {name for name, value in loaded.items() if value.ndim == 1}
    assert len(norms) == 40
    assert all(torch.equal(loaded[name], before[name]) for name in norms)
    assert all(torch.equal(loaded[name], state[name]) for name in loaded.keys() - norms)


def test_group_normalisation_can_keep_scale_and_bias_of_the_file(store, folder):
    state = torchvision_state()
    _, loaded = filled(ResNetConfig(keep_affine=True), store(state), folder)
    assert all(torch.equal(value, state[name]) for name, value in loaded.items())


def test_group_normalisation_keeps_scales_and_biases_that_were_learned_with_it(store, folder):
    learned = build_backbone(ResNetConfig(), (64, 64)).state_dict()
    state = fixed_weights({name: value.shape for name, value in learned.items()})
    _, loaded = filled(ResNetConfig(), store(state), folder)
    assert all(torch.equal(value, state[name]) for name, value in loaded.items())


def test_spatial_softmax_learns_its_maps_from_scratch(store, folder):
    before, loaded = filled(ResNetConfig(pool="spatial_softmax"), store(torchvision_state()), folder)
    assert torch.equal(loaded["pool.maps.weight"], before["pool.maps.weight"])


def test_a_file_of_r3m_is_unwrapped_and_its_reading_of_sentences_left_out(store, folder):
    state = {name: value for name, value in torchvision_state().items() if not name.startswith("fc.")}
    wrapped = {f"module.convnet.{name}": value for name, value in state.items()}
    wrapped |= {"module.lang_enc.weight": torch.zeros(3), "module.lang_rew.0.bias": torch.zeros(3)}
    weights = store({"r3m": wrapped, "global_step": 7, "lr": 0.5})
    _, loaded = filled(ResNetConfig(norm="batch"), weights, folder)
    assert all(torch.equal(value, state[name]) for name, value in loaded.items())


def test_a_file_of_vip_brings_its_last_layer(store, folder):
    state = torchvision_state(depth=50, classes=1024)
    weights = store({"vip": {f"module.convnet.{name}": value for name, value in state.items()}})
    _, loaded = filled(ResNetConfig(depth=50, norm="batch", outputs=1024), weights, folder)
    assert torch.equal(loaded["fc.weight"], state["fc.weight"])


def test_a_file_of_mae_fills_a_vit_of_any_size(store, folder):
    config = ViTConfig()
    with torch.device("meta"):
        shapes = {name: value.shape for name, value in build_backbone(config, (224, 224)).state_dict().items()}
    state = fixed_weights({**shapes, "mask_token": torch.Size([1, 1, 384]), "decoder_embed.weight": torch.Size([2, 2])})
    weights = store({"model": state})
    _, loaded = filled(config, weights, folder, size=(224, 224))
    assert torch.equal(loaded["pos_embed"], state["pos_embed"])
    _, loaded = filled(config, weights, folder, size=(96, 128))
    assert loaded["pos_embed"].shape == (1, 1 + 6 * 8, 384)
    assert torch.equal(loaded["pos_embed"][:, 0], state["pos_embed"][:, 0])


def test_a_file_of_ones_own_may_be_safetensors_of_which_a_part_is_taken(store, folder):
    config = PatchCNNConfig()
    shapes = {name: value.shape for name, value in build_backbone(config, (32, 32)).state_dict().items()}
    state = fixed_weights(shapes)
    content = save({**{f"front.{name}": value for name, value in state.items()}, "head.bias": torch.zeros(3)})
    _, loaded = filled(config, store(content, "mine.safetensors", part="front."), folder, size=(32, 32))
    assert all(torch.equal(value, state[name]) for name, value in loaded.items())


def test_a_spatial_softmax_takes_its_maps_from_a_file_that_has_them_and_else_keeps_its_own(store, folder):
    config = ResNetConfig(pool="spatial_softmax")
    learned = fixed_weights({"pool.maps.weight": torch.Size([32, 512, 1, 1]), "pool.maps.bias": torch.Size([32])})
    for state, expected in ((torchvision_state(), None), ({**torchvision_state(), **learned}, learned)):
        before, loaded = filled(config, store(state), folder)
        assert all(torch.equal(loaded[name], (expected or before)[name]) for name in learned)


@pytest.mark.parametrize(
    ("state", "difference"),
    [
        (lambda: torchvision_state(34), r"96 belong elsewhere \(e\.g\. 'layer1\.2\.bn1\.bias'\)"),
        (lambda: torchvision_state(50), r"belong elsewhere .*, [0-9]+ have another shape"),
        (
            lambda: {name: value for name, value in torchvision_state().items() if name != "conv1.weight"},
            r"1 are missing \(e\.g\. 'conv1\.weight'\)$",
        ),
        (
            lambda: {**torchvision_state(), "conv1.weight": torch.zeros(64, 3, 3, 3)},
            r"1 have another shape \(e\.g\. 'conv1\.weight'\)$",
        ),
    ],
)
def test_weights_of_another_network_are_refused_with_what_differs(state, difference, store, folder):
    with pytest.raises(UnusableWeights, match="another network than resnet norm=batch: .*" + difference):
        filled(ResNetConfig(norm="batch"), store(state()), folder)


def test_weights_that_are_no_numbers_are_refused(store, folder):
    state = {**torchvision_state(), "conv1.weight": torch.full((64, 3, 7, 7), torch.nan)}
    with pytest.raises(UnusableWeights, match=r"'conv1\.weight' holds numbers that are not finite"):
        filled(ResNetConfig(norm="batch"), store(state), folder)


def test_a_pickle_with_code_is_refused_and_the_code_does_not_run(store, folder, tmp_path):
    target = tmp_path / "code ran"
    for content in ({"conv1.weight": Bomb(target)}, pickle.dumps({"conv1.weight": Bomb(target)})):
        with pytest.raises(UnusableWeights, match=r"a pickle that holds more than tensors.*convert it"):
            filled(ResNetConfig(), store(content), folder)
    assert not target.exists()


def _bad_zip():
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("archive/data.pkl", b"\x80")
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (b"", "mine.pth"),
        (b"\x00" * 100, "mine.pth"),
        (b"<!DOCTYPE html><html>not found</html>", "mine.pth"),
        (b"version https://git-lfs.github.com/spec/v1", "mine.pth"),
        (b"\x80\x02" + b"\x85" * 50, "mine.pth"),
        (b"\x80\x02K\x01.", "mine.pth"),
        (b"PK\x03\x04" + b"x" * 50, "mine.pth"),
        (_bad_zip(), "mine.pth"),
        (b"\xff" * 100, "mine.safetensors"),
        (b"", "mine.safetensors"),
        ([1, 2, 3], "mine.pth"),
        ({"conv1.weight": 3}, "mine.pth"),
        ({}, "mine.pth"),
        ({"model": {"a": "b"}}, "mine.pth"),
        (torch.zeros(3), "mine.pth"),
    ],
)
def test_what_holds_no_weights_is_refused_in_a_sentence(content, name, store, folder):
    with pytest.raises(UnusableWeights, match=f"'{name}' (cannot be read as weights|holds something else|is a pickle)"):
        filled(ResNetConfig(), store(content, name), folder)


def test_a_web_page_saved_as_weights_is_not_taken_for_a_pickle(store, folder):
    with pytest.raises(UnusableWeights, match=r"cannot be read as weights: it is not a file that torch wrote"):
        filled(ResNetConfig(), store(b"<!DOCTYPE html>"), folder)


@pytest.mark.filterwarnings("ignore")
def test_a_damaged_file_of_long_ago_is_refused_whatever_is_damaged(store, folder):
    buffer = io.BytesIO()
    torch.save({"conv1.weight": torch.zeros(4)}, buffer, _use_new_zipfile_serialization=False)
    content = buffer.getvalue()
    backbone = build_backbone(ResNetConfig(), (64, 64))
    for place in range(2, len(content), 3):
        damaged = content[:place] + bytes([content[place] ^ 0x5A]) + content[place + 1 :]
        backbone.config = ResNetConfig(weights=store(damaged))
        with pytest.raises(UnusableWeights, match=r"'mine\.pth'"):
            load_pretrained(torch.nn.Sequential(backbone), folder)


def test_a_licence_that_allows_no_commercial_use_is_said_once(store, folder, caplog):
    weights = store(torchvision_state()).model_copy(update={"licence": "CC-BY-NC-4.0"})
    two = [build_backbone(ResNetConfig(weights=weights), (32, 32)) for _ in range(2)]
    with caplog.at_level(logging.WARNING):
        assert [each.weights for each in load_pretrained(torch.nn.ModuleList(two), folder)] == [weights]
    assert [record.getMessage() for record in caplog.records] == [
        "the weights 'mine.pth' may not be used commercially: CC-BY-NC-4.0"
    ]


def test_nothing_is_read_where_nothing_is_pretrained(folder):
    assert load_pretrained(build_backbone(ResNetConfig(), (32, 32)), folder) == ()
