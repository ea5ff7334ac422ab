"""Policies that see are trained, saved and act like others; what is frozen stays as it was."""

from __future__ import annotations

import dataclasses
import hashlib
import io

import numpy as np
import pytest
import torch

from juicer.errors import UnusableWeights
from juicer.policy.backbone import build_backbone
from juicer.policy.backbones.efficientnet_lite.config import EfficientNetLiteConfig
from juicer.policy.backbones.patch_cnn.config import PatchCNNConfig
from juicer.policy.checkpoint import load_policy, save_checkpoint
from juicer.policy.config import HorizonConfig, PolicyConfig
from juicer.policy.encoder import outline
from juicer.policy.encoders.estimated.config import EstimatedConfig
from juicer.policy.encoders.estimated.estimator import build_estimator
from juicer.policy.encoders.estimated.files import load_estimator, save_estimator
from juicer.policy.encoders.images.config import ImagesConfig
from juicer.policy.encoders.proprioception.config import ProprioceptionConfig
from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.policy.image_augmentation.config import ImageAugmentation
from juicer.policy.pretrained.config import Weights
from juicer.policy.served import ServedPolicy
from juicer.training.fixed import FixedEncoder
from juicer.training.trainer import LOADERS, default_loaders, train
from juicer.training.windows import TrainingEpisodes
from juicer.views import View

VIEWS = {"front": View(camera="front", width=16, height=16), "wrist": View(camera="wrist", width=16, height=16)}
SMALL = PatchCNNConfig(quarter=4, quarter_blocks=0, eighth=4, eighth_blocks=1, maps=2, grid=1)


@pytest.fixture
def seen():
    """Four short episodes with images."""
    rng, steps = np.random.default_rng(0), 4 * 20
    observations = {view.name: rng.integers(0, 256, (steps, 16, 16, 3), dtype=np.uint8) for view in VIEWS.values()}
    observations["proprioception"] = rng.normal(size=(steps, 16)).astype(np.float32)
    actions = rng.uniform(-0.5, 0.5, size=(steps, 10)).astype(np.float32)
    return TrainingEpisodes(observations, actions, np.arange(20, steps + 1, 20), list("abcd"), ["teleop"] * 4)


@pytest.fixture
def training_config(training_config):
    """A few steps: what is asked here shows after one."""
    return training_config.model_copy(update={"steps": 12, "save_every": 5, "batch_size": 8, "validate_every": 12})


def policy_of(**settings):
    images = ImagesConfig(**{"views": VIEWS, "backbone": SMALL, "projection": 8, **settings})
    return PolicyConfig(
        horizons=HorizonConfig(obs=2, pred=8, action=4),
        observation={"proprioception": ProprioceptionConfig(), "images": images},
        head=MLPHeadConfig(width=32, blocks=1),
    )


def images_of(checkpoint, state="weights"):
    prefix = "encoders.members.1.backbones."
    return {
        name.removeprefix(prefix): value
        for name, value in getattr(checkpoint, state).items()
        if name.startswith(prefix)
    }


def stored(backbone, folder, name="mine.pth"):
    buffer = io.BytesIO()
    torch.save(backbone.state_dict(), buffer)
    folder.mkdir(exist_ok=True)
    (folder / name).write_bytes(buffer.getvalue())
    return Weights(file=name, sha256=hashlib.sha256(buffer.getvalue()).hexdigest(), licence="MIT")


def with_features(episodes, policy, folder, tasks=None, estimators=()):
    """Episodes with what the frozen parts of a policy make of their images."""
    shown = dict(episodes.observations)
    for part in policy.fixed_parts:
        encoder = FixedEncoder(part, tasks, folder, estimators, "cpu")
        shown |= encoder.columns({name: shown[name] for name in encoder.observes})
    return dataclasses.replace(episodes, observations=shown)


@pytest.mark.parametrize("frozen", [False, True])
def test_a_policy_that_sees_is_trained_saved_and_acts(frozen, seen, tasks, training_config, tmp_path):
    backbone = SMALL.model_copy(update={"weights": stored(build_backbone(SMALL, (16, 16)), tmp_path)})
    policy = policy_of(backbone=backbone, frozen=frozen, augmentation=None if frozen else ImageAugmentation())
    learned = with_features(seen, policy, tmp_path)
    trained = train([learned], policy, tasks, training_config, seed=0, weights=tmp_path).checkpoint
    save_checkpoint(tmp_path, trained)
    acting = load_policy(tmp_path, next(iter(tasks)))
    assert [spec.name for spec in acting.observations] == ["proprioception", *(view.name for view in VIEWS.values())]
    rows = {name: values[:6].reshape(3, 2, *values.shape[1:]) for name, values in seen.observations.items()}
    streams = [np.random.default_rng(index) for index in range(3)]
    actions = acting.predict(rows, streams)
    assert actions.shape == (3, 4, 10)
    alone = acting.predict({name: values[1:2] for name, values in rows.items()}, [np.random.default_rng(1)])
    np.testing.assert_array_equal(alone[0], actions[1])
    served = ServedPolicy(acting).predict({name: list(values) for name, values in rows.items()})
    assert served.shape == actions.shape


def test_a_resumed_training_of_images_ends_bit_for_bit_as_an_unbroken_one(seen, tasks, training_config, tmp_path):
    policy = policy_of(augmentation=ImageAugmentation())
    config = training_config.model_copy(update={"report_every": 1})
    unbroken = train([seen], policy, tasks, config, seed=0).checkpoint

    class KilledError(Exception):
        pass

    def kill(done, total, **facts):
        if done >= config.save_every + 1:
            raise KilledError

    with pytest.raises(KilledError):
        train([seen], policy, tasks, config, seed=0, scratch=tmp_path, progress=kill)
    resumed = train([seen], policy, tasks, config, seed=0, scratch=tmp_path).checkpoint
    assert all(torch.equal(value, resumed.weights[name]) for name, value in unbroken.weights.items())


def test_what_is_frozen_stays_as_its_file_has_it_and_acting_needs_no_file(seen, tasks, training_config, tmp_path):
    torch.manual_seed(5)
    source = build_backbone(EfficientNetLiteConfig(), (16, 16))
    backbone = EfficientNetLiteConfig(weights=stored(source, tmp_path / "weights"))
    policy = policy_of(backbone=backbone, frozen=True)
    learned = with_features(seen, policy, tmp_path / "weights")
    trained = train([learned], policy, tasks, training_config, seed=0, weights=tmp_path / "weights")
    for state in ("weights", "ema"):
        if getattr(trained.checkpoint, state) is not None:
            kept = images_of(trained.checkpoint, state)
            assert all(torch.equal(value, kept[f"0.{name}"]) for name, value in source.state_dict().items())
    assert trained.facts["pretrained"] == "mine.pth (MIT)"
    save_checkpoint(tmp_path / "checkpoint", trained.checkpoint)
    (tmp_path / "weights" / "mine.pth").unlink()
    assert load_policy(tmp_path / "checkpoint", next(iter(tasks)))


def test_what_is_trained_starts_from_its_file_and_leaves_it(seen, tasks, training_config, tmp_path):
    source = build_backbone(SMALL, (16, 16))
    backbone = SMALL.model_copy(update={"weights": stored(source, tmp_path)})
    config = training_config.model_copy(update={"learning_rate": 1e-9, "weight_decay": 0.0, "ema_decay": None})
    trained = train([seen], policy_of(backbone=backbone), tasks, config, seed=0, weights=tmp_path).checkpoint
    for name, value in source.state_dict().items():
        for view in range(2):
            torch.testing.assert_close(images_of(trained)[f"{view}.{name}"], value, atol=1e-6, rtol=0)


def test_statistics_of_batches_pass_into_the_moving_average(seen, tasks, training_config):
    policy = policy_of(backbone=EfficientNetLiteConfig())
    config = training_config.model_copy(update={"steps": 4, "warmup_steps": 1, "batch_size": 32, "ema_decay": 0.99})
    trained = train([seen], policy, tasks, config, seed=0).checkpoint
    own, average = images_of(trained), images_of(trained, "ema")
    assert float(own["0._bn0.running_mean"].abs().max()) > 0
    assert torch.equal(own["0._bn0.running_mean"], average["0._bn0.running_mean"])


def test_a_training_whose_weights_are_missing_says_which(seen, tasks, training_config, tmp_path):
    policy = policy_of(backbone=EfficientNetLiteConfig(weights=Weights(file="a.pth", sha256="0" * 64, licence="MIT")))
    with pytest.raises(UnusableWeights, match=f"the weights 'a.pth' are not on this machine.*into '{tmp_path}'"):
        train([seen], policy, tasks, training_config, seed=0, weights=tmp_path)


def test_batches_are_gathered_ahead_of_a_gpu_only_if_images_are_learned_from(tasks):
    weights = Weights(file="any.pth", sha256="0" * 64, licence="MIT")
    frozen = policy_of(backbone=SMALL.model_copy(update={"weights": weights}), frozen=True)
    estimated = PolicyConfig(observation={"state": EstimatedConfig()})
    loaders = {
        name: default_loaders(outline(policy, tasks), torch.device("cuda"))
        for name, policy in {"images": policy_of(), "frozen": frozen, "estimated": estimated}.items()
    }
    assert loaders == {"images": LOADERS, "frozen": 0, "estimated": 0}
    assert default_loaders(outline(policy_of(), tasks), torch.device("cpu")) == 0


def estimator_of(spec, folder, **backbone):
    """An estimator's configuration, and the folder of one with random weights."""
    settings = {"views": VIEWS, "backbone": {**SMALL.model_dump(), **backbone}, "width": 8}
    config = EstimatedConfig.model_validate({"estimator": settings})
    folder.mkdir()
    save_estimator(folder, build_estimator(config, "toy", spec, seed=4))
    return config


def test_what_starts_from_an_estimator_says_so_and_so_does_what_starts_from_that(
    seen, tasks, spec, training_config, tmp_path
):
    estimator_of(spec, tmp_path / "estimator")
    place, part, learned = tmp_path / "estimator", "backbones.0.", []
    for number in range(2):
        (file,) = place.glob("weights.safetensors")
        file.rename(tmp_path / f"{number}.safetensors")
        digest = hashlib.sha256((tmp_path / f"{number}.safetensors").read_bytes()).hexdigest()
        origin = Weights(file=f"{number}.safetensors", sha256=digest, licence="MIT", part=part)
        policy = policy_of(backbone=SMALL.model_copy(update={"weights": origin}))
        learned.append(train([seen], policy, tasks, training_config, seed=0, weights=tmp_path))
        place, part = tmp_path / f"checkpoint{number}", "encoders.members.1.backbones.0."
        save_checkpoint(place, learned[-1].checkpoint)
    assert {each.observes for each in learned} == {"images, started from pose supervision"}
    assert train([seen], policy_of(), tasks, training_config, seed=0).observes == "images"


def test_a_policy_takes_its_estimator_as_it_has_learned_and_not_what_that_started_from(
    seen, tasks, spec, training_config, tmp_path
):
    origin = stored(build_backbone(SMALL, (16, 16)), tmp_path)
    config = estimator_of(spec, tmp_path / "estimator", weights=origin.model_dump())
    policy = policy_of().model_copy(update={"observation": {"state": config}})
    folder = tmp_path / "estimator"
    learned = with_features(seen, policy, tmp_path, tasks, [folder])
    trained = train([learned], policy, tasks, training_config, seed=0, estimators=[folder], weights=tmp_path)
    for name, value in load_estimator(folder).state_dict().items():
        assert torch.equal(trained.checkpoint.weights[f"encoders.members.0.estimators.0.{name}"], value)
