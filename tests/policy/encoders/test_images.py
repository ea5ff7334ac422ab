"""Images as observations: raw until a batch goes through the network."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from juicer.config import parse_config
from juicer.errors import ConfigError, InvalidObservation
from juicer.policy.acting import TrainedPolicy
from juicer.policy.backbones.patch_cnn.config import PatchCNNConfig
from juicer.policy.config import PolicyConfig, rough_parameters
from juicer.policy.encoder import Encoders, build_encoder
from juicer.policy.encoders.images.config import ImagesConfig
from juicer.policy.image_augmentation.config import ImageAugmentation
from juicer.policy.network import build_policy
from juicer.policy.pretrained.config import Weights
from juicer.views import View

FILED = PatchCNNConfig(weights=Weights(file="any.pth", sha256="0" * 64, licence="MIT"))
"""A backbone that may be frozen; its file is needed by nobody here."""
VIEWS = {"front": View(camera="front", width=32, height=24), "wrist": View(camera="wrist", width=16, height=16)}


def images_of(encoder, rows=3, steps=2, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return {
        spec.name: torch.randint(0, 256, (rows, steps, *spec.shape), dtype=torch.uint8, generator=generator)
        for spec in encoder.observations
    }


def test_every_view_and_observed_step_has_a_token(tasks):
    encoder = build_encoder(ImagesConfig(views=VIEWS, projection=7), tasks, obs_horizon=2)
    tokens = encoder(encoder.prepare(images_of(encoder)))
    assert tokens.shape == (3, *encoder.token_size) == (3, 4, 7)


def test_tokens_of_a_step_are_its_views_and_depend_on_nothing_else(tasks):
    encoder = build_encoder(ImagesConfig(views=VIEWS), tasks, obs_horizon=2)
    images = images_of(encoder)
    tokens = encoder(encoder.prepare(images))
    images[VIEWS["wrist"].name][1, 0] = 0
    differs = (encoder(encoder.prepare(images)) - tokens).abs().amax(dim=-1) > 0
    assert differs.nonzero().tolist() == [[1, 1]]


def test_images_are_prepared_without_a_copy(tasks):
    encoder = build_encoder(ImagesConfig(views=VIEWS), tasks, obs_horizon=1)
    images = images_of(encoder)
    prepared = encoder.prepare(images)
    assert {name: values.data_ptr() for name, values in prepared.items()} == {
        name: images[view.name].data_ptr() for name, view in VIEWS.items()
    }


def test_what_is_prepared_is_flat_so_that_anybody_can_take_rows_of_it(tasks, observe):
    config = PolicyConfig(
        observation={"images": ImagesConfig(views=VIEWS), "state": PolicyConfig().observation["state"]}
    )
    encoders = Encoders(config, tasks)
    shown = images_of(encoders.members[0], rows=5, steps=1)
    shown |= {name: torch.from_numpy(values)[:, None] for name, values in observe(5).items()}
    prepared = encoders.prepare(shown)
    assert list(prepared) == ["images.front", "images.wrist", "state"]
    some = encoders({name: values[[4, 1]] for name, values in prepared.items()})
    for name, tokens in encoders(prepared).items():
        assert torch.allclose(some[name], tokens[[4, 1]], atol=1e-6)


def test_what_is_trained_is_trained_in_every_view_and_what_is_frozen_in_none(tasks):
    for frozen in (False, True):
        encoder = build_encoder(ImagesConfig(views=VIEWS, backbone=FILED, frozen=frozen), tasks, obs_horizon=2)
        images = images_of(encoder)
        encoder(encoder.prepare({**images, **encoder.derive(images)})).sum().backward()
        assert len(encoder.backbones) == (1 if frozen else 2)
        assert all((each.grad is None) is frozen for each in encoder.backbones.parameters())
        assert all(each.grad is not None for each in encoder.projections.parameters())


def test_two_names_may_show_one_view(tasks):
    encoder = build_encoder(ImagesConfig(views={"a": VIEWS["front"], "b": VIEWS["front"]}), tasks, obs_horizon=1)
    assert [spec.name for spec in encoder.observations] == [VIEWS["front"].name]


@pytest.mark.parametrize("frozen", [True, False])
@pytest.mark.parametrize("projection", [128, None])
def test_the_size_of_a_policy_that_sees_is_known_before_it_is_built(tasks, frozen, projection):
    images = ImagesConfig(backbone=FILED, frozen=frozen, projection=projection)
    config = PolicyConfig(observation={"images": images}, head={"kind": "mlp"})
    assert rough_parameters(config) == pytest.approx(build_policy(config, tasks, 0).num_parameters, rel=0.05)


def test_a_policy_too_large_for_memory_is_refused_before_it_is_built():
    backbone = {"kind": "patch_cnn", "eighth": 1024, "grid": 16}
    images = {"kind": "images", "backbone": backbone, "projection": 16_384}
    with pytest.raises(ConfigError, match=r"a policy of about .* weights is too large"):
        parse_config({"observation": {"images": images}}, PolicyConfig, origin="test")


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (np.full((1, 24, 32, 3), np.nan, np.float32), "must be of type uint8, got float32"),
        (np.zeros((1, 32, 24, 3), np.uint8), r"must have shape \(1, 1, 24, 32, 3\)"),
    ],
)
def test_an_image_that_is_none_of_its_view_is_refused_when_acting(values, sentence, tasks):
    images = ImagesConfig(views={"front": VIEWS["front"]})
    acting = TrainedPolicy(
        build_policy(PolicyConfig(observation={"images": images}, head={"kind": "mlp"}), tasks, 0), "toy"
    )
    shown = {"proprioception": np.zeros((1, 16), np.float32), VIEWS["front"].name: values}
    with pytest.raises(InvalidObservation, match=sentence):
        acting.predict(shown, [np.random.default_rng(0)])


def test_a_view_too_small_for_the_backbone_is_refused_in_a_sentence():
    images = {"kind": "images", "views": {"front": {"camera": "front", "width": 4}}}
    with pytest.raises(
        ConfigError,
        match=r"observation\.images.*a patch_cnn takes images whose .* multiples of 8 pixels",
    ):
        parse_config({"observation": {"images": images}}, PolicyConfig, origin="test")


VARIED = {"augmentation": {}, "crops": {"front": {"width": 24, "height": 16}}}


def test_images_vary_in_training_and_not_when_acting(tasks):
    encoder = build_encoder(ImagesConfig.model_validate({"views": VIEWS, **VARIED}), tasks, obs_horizon=2)
    prepared = encoder.prepare(images_of(encoder))
    assert not torch.equal(encoder(prepared), encoder(prepared))
    torch.manual_seed(3)
    first = encoder(prepared)
    torch.manual_seed(3)
    assert torch.equal(encoder(prepared), first)
    encoder.eval()
    assert torch.equal(encoder(prepared), encoder(prepared))


def test_only_the_middle_of_a_cropped_view_is_seen_when_acting(tasks):
    encoder = build_encoder(ImagesConfig.model_validate({"views": VIEWS, **VARIED}), tasks, obs_horizon=1).eval()
    images = images_of(encoder, steps=1)
    tokens = encoder(encoder.prepare(images))
    outside = torch.ones(24, 32, dtype=torch.bool)
    outside[4:20, 4:28] = False
    images[VIEWS["front"].name][:, :, outside] = 0
    assert torch.equal(encoder(encoder.prepare(images)), tokens)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        (
            {"crops": {"frond": {"width": 8, "height": 8}}},
            "crops name 'frond', which is none of the views: front, wrist",
        ),
        ({"crops": {"wrist": {"width": 8, "height": 20}}}, "the crop of 'wrist' is larger than its 16x16 pixels"),
        ({"augmentation": {"blur_kernel": 31}, "crops": {}, "backbone": {"kind": "resnet"}}, None),
        (
            {"augmentation": {"blur_kernel": 31}, "views": {"a": {"camera": "front", "width": 8, "height": 16}}},
            "the blur of 'a' reaches beyond its 8x16 pixels",
        ),
        (
            {
                "frozen": True,
                "backbone": {"kind": "vit", "weights": FILED.weights.model_dump()},
                "views": {"a": {"camera": "front"}, "b": {"camera": "wrist", "width": 32}},
            },
            "a frozen vit is one for all views: give these one size",
        ),
    ],
)
def test_crops_and_blurs_that_do_not_fit_are_refused_in_a_sentence(settings, sentence):
    views = {name: view.model_dump() for name, view in VIEWS.items()}
    content = {"observation": {"images": {"kind": "images", "views": views, **settings}}}
    if sentence is None:
        assert parse_config(content, PolicyConfig, origin="test")
    else:
        with pytest.raises(ConfigError, match=sentence):
            parse_config(content, PolicyConfig, origin="test")


def test_what_is_frozen_sees_the_middle_of_an_image_and_no_variation():
    view = View(camera="front", width=32, height=24)
    crop = {"front": {"width": 16, "height": 16}}
    config = ImagesConfig(views={"front": view}, crops=crop, backbone=FILED, frozen=True)
    encoder = build_encoder(config, {}, obs_horizon=1)
    images = torch.randint(0, 256, (4, 24, 32, 3), dtype=torch.uint8)
    edges = images.clone()
    edges[:, :, :8] = 0
    seen = [
        encoder.train(mode).derive({view.name: each})[config.column("front")]
        for mode in (True, False)
        for each in (images, edges)
    ]
    for other in seen[1:]:
        torch.testing.assert_close(other, seen[0])
    with pytest.raises(ValidationError, match="what is frozen sees every image once, before the training: leave out"):
        ImagesConfig(views={"front": view}, backbone=FILED, frozen=True, augmentation=ImageAugmentation())


def test_features_have_a_name_for_what_computes_them_and_none_for_what_is_learned():
    frozen = ImagesConfig(backbone=FILED, frozen=True)
    (front, wrist) = frozen.fixed_parts
    assert frozen.column("front") == front.column("only") != frozen.column("wrist") == wrist.column("only")
    assert ImagesConfig(backbone=FILED, frozen=True, projection=None).column("front") == frozen.column("front")
    assert ImagesConfig().fixed_parts == ()
    assert frozen.learned_views == ()


@pytest.mark.parametrize(
    ("backbone", "name"),
    [
        ({"kind": "patch_cnn"}, "patch_cnn"),
        ({"kind": "resnet", "pool": "spatial_softmax"}, "resnet pool=spatial_softmax"),
        ({"kind": "resnet", "pool": "spatial_softmax", "weights": "resnet18_imagenet"}, "resnet pool=spatial_softmax"),
    ],
)
def test_what_is_frozen_comes_from_a_file_as_a_whole(backbone, name):
    with pytest.raises(ValidationError, match=f"a frozen backbone keeps .* those of {name} are random"):
        ImagesConfig.model_validate({"frozen": True, "backbone": backbone})
    assert ImagesConfig.model_validate({"backbone": backbone})
