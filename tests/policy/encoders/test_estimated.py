"""Policies that learn from true poses and act on what an estimator reads off images."""

from __future__ import annotations

import json

import pytest
import torch

from juicer.errors import ConfigError, InvalidCheckpoint
from juicer.policy.backbones.patch_cnn.config import PatchCNNConfig
from juicer.policy.checkpoint import Checkpoint, CheckpointMetadata, load_checkpoint, save_checkpoint
from juicer.policy.config import PolicyConfig
from juicer.policy.encoder import Encoders
from juicer.policy.encoders.estimated.config import EstimatedConfig, EstimatorConfig
from juicer.policy.encoders.estimated.estimator import build_estimator
from juicer.policy.encoders.estimated.files import ESTIMATOR_FILE, WEIGHTS_FILE, load_estimator, save_estimator
from juicer.policy.network import build_policy
from juicer.views import View

VIEWS = {"front": View(camera="front", width=16, height=16), "wrist": View(camera="wrist", width=32, height=16)}
SMALL = PatchCNNConfig(quarter=8, eighth=8, quarter_blocks=0, eighth_blocks=1, maps=4)
CONFIG = EstimatedConfig(estimator=EstimatorConfig(views=VIEWS, backbone=SMALL, width=16))
POLICY = PolicyConfig(observation={"state": CONFIG}, head={"kind": "mlp", "width": 16, "blocks": 1})


@pytest.fixture
def observations(observe):
    return {name: torch.from_numpy(values)[:, None] for name, values in observe(6).items()}


def kept(folder, *estimators):
    """Folders that hold them."""
    folders = [folder / str(number) for number in range(len(estimators))]
    for each, estimator in zip(folders, estimators, strict=True):
        each.mkdir()
        save_estimator(each, estimator)
    return folders


@pytest.fixture
def estimator(spec, observations):
    from juicer.policy.encoders.features.features import state_features

    estimator = build_estimator(CONFIG, "toy", spec, seed=1)
    estimator.normalizer.fit(state_features(observations, spec, CONFIG.features))
    return estimator


def images(rows=6, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return {
        view.name: torch.randint(0, 256, (rows, 1, view.height, view.width, 3), dtype=torch.uint8, generator=generator)
        for view in VIEWS.values()
    }


def test_it_learns_from_estimates_and_acts_on_images(tasks):
    encoders = Encoders(POLICY, tasks)
    assert [spec.name for spec in encoders.training_observations] == ["proprioception", CONFIG.column]
    assert [spec.name for spec in encoders.observations] == ["proprioception", *(view.name for view in VIEWS.values())]
    assert encoders.account == "images, poses in training"
    assert POLICY.learned_views == ()
    assert POLICY.fixed_parts == (CONFIG,)


def learned_from(encoders, observations, seed=0):
    """What it is shown in training of steps at which it sees some images."""
    proprioception = observations["proprioception"]
    seen = {**observations, **images(len(proprioception), seed)}
    return {"proprioception": proprioception, **encoders.members[0].derive(seen)}


def test_what_it_is_shown_in_training_is_what_it_sees_when_acting(tmp_path, tasks, observations, estimator):
    encoders = Encoders(POLICY, tasks)
    encoders.take_estimators(kept(tmp_path, estimator))
    shown = learned_from(encoders, observations)
    encoders.fit(shown)
    learned = encoders.prepare_training(shown)["state"]
    assert learned.abs().max() <= 1 + 1e-5
    acting = encoders.prepare({"proprioception": observations["proprioception"], **images()})["state"]
    torch.testing.assert_close(acting, learned, rtol=0, atol=0)


def test_estimates_go_through_the_policys_own_limits_and_clip(tmp_path, tasks, observations, estimator):
    encoders = Encoders(POLICY, tasks)
    encoders.take_estimators(kept(tmp_path, estimator))
    encoders.fit(learned_from(encoders, observations, seed=1))
    shown = {"proprioception": observations["proprioception"], **images()}
    seen = encoders.prepare(shown)["state"]
    limits = encoders.members[0].features.normalizers[0]
    expected = limits.normalize(estimator(shown)).clamp(-CONFIG.features.clip, CONFIG.features.clip)
    torch.testing.assert_close(seen, expected)


def test_the_estimator_is_no_part_of_what_is_learned(tasks):
    network = build_policy(POLICY, tasks, seed=0).train()
    learned = [name for name, parameter in network.named_parameters() if parameter.requires_grad]
    assert learned == [f"head.{name}" for name, _ in network.head.named_parameters()]
    assert not network.encoders.members[0].estimators.training


def test_a_policy_of_several_tasks_has_an_estimator_for_each(tmp_path, spec, observations):
    tasks = {"toy": spec, "other": spec.model_copy(update={"mounted_m": 0.01})}
    encoders = Encoders(POLICY, tasks)
    encoders.take_estimators(
        kept(tmp_path, *(build_estimator(CONFIG, *each, seed) for seed, each in enumerate(tasks.items())))
    )
    number = torch.arange(6).remainder(2).reshape(6, 1, 1).float()
    encoders.fit({**learned_from(encoders, {**observations, "task": number}), "task": number})
    first, second = (
        encoders.prepare(
            {"proprioception": observations["proprioception"], **images(), "task": torch.full((6, 1, 1), task)}
        )
        for task in (0.0, 1.0)
    )
    assert not torch.equal(first["state"], second["state"])


def test_without_an_estimator_it_says_how_to_make_one(tmp_path, tasks, spec):
    encoders = Encoders(POLICY, tasks)
    larger = CONFIG.model_copy(update={"estimator": CONFIG.estimator.model_copy(update={"width": 32})})
    with pytest.raises(ConfigError, match=r"poses of toy from images, and no estimator .* stage 'estimate'"):
        encoders.take_estimators(kept(tmp_path, build_estimator(larger, "toy", spec, seed=0)))


def test_an_estimator_of_another_task_is_not_taken_though_its_numbers_are_the_same(tmp_path, tasks, spec):
    encoders = Encoders(POLICY, tasks)
    with pytest.raises(ConfigError, match="poses of toy from images, and no estimator"):
        encoders.take_estimators(kept(tmp_path, build_estimator(CONFIG, "other", spec, seed=0)))


def test_of_two_estimators_that_fit_none_is_taken(tmp_path, tasks, spec):
    encoders = Encoders(POLICY, tasks)
    folders = kept(tmp_path, *(build_estimator(CONFIG, "toy", spec, seed) for seed in range(2)))
    with pytest.raises(ConfigError, match=r"2 estimators of this configuration were given for toy, .* give one"):
        encoders.take_estimators(folders)
    encoders.take_estimators([folders[0], folders[0]])


def test_a_checkpoint_acts_without_anything_beside_it(tmp_path, tasks, observations, estimator):
    network = build_policy(POLICY, tasks, seed=0)
    network.encoders.take_estimators(kept(tmp_path, estimator))
    network.encoders.fit(learned_from(network.encoders, observations))
    metadata = CheckpointMetadata(policy=POLICY, tasks=tasks, acting_weights="raw", step=1)
    save_checkpoint(tmp_path / "checkpoint", Checkpoint(metadata, network.state_dict(), None))
    policy = load_checkpoint(tmp_path / "checkpoint").policy("toy")
    shown = {"proprioception": observations["proprioception"], **images()}
    seen = policy._network.encoders.prepare(shown)["state"]
    torch.testing.assert_close(seen, network.encoders.prepare(shown)["state"], rtol=0, atol=0)


def test_an_estimator_is_kept_in_files(tmp_path, estimator, observations):
    save_estimator(tmp_path, estimator.to(memory_format=torch.channels_last))
    loaded = load_estimator(tmp_path)
    assert loaded.is_like(estimator)
    shown = {"proprioception": observations["proprioception"], **images()}
    torch.testing.assert_close(loaded(shown), estimator(shown))
    assert {path.name for path in tmp_path.iterdir()} == {ESTIMATOR_FILE, WEIGHTS_FILE}


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        ({"schema_version": 99}, "schema version 99"),
        ({"surprise": 1}, "surprise"),
        ({"spec": None}, "spec"),
    ],
)
def test_a_file_that_means_something_else_is_refused(tmp_path, estimator, damage, sentence):
    save_estimator(tmp_path, estimator)
    path = tmp_path / ESTIMATOR_FILE
    path.write_text(json.dumps({**json.loads(path.read_text()), **damage}))
    with pytest.raises(InvalidCheckpoint, match=sentence):
        load_estimator(tmp_path)


def test_weights_of_another_network_are_refused(tmp_path, estimator, spec):
    save_estimator(tmp_path, estimator)
    larger = CONFIG.model_copy(update={"estimator": CONFIG.estimator.model_copy(update={"width": 32})})
    other = tmp_path / "other"
    other.mkdir()
    save_estimator(other, build_estimator(larger, "toy", spec, seed=0))
    (other / WEIGHTS_FILE).replace(tmp_path / WEIGHTS_FILE)
    with pytest.raises(InvalidCheckpoint, match="does not fit its own configuration"):
        load_estimator(tmp_path)


def test_a_folder_without_an_estimator_is_refused(tmp_path):
    with pytest.raises(InvalidCheckpoint, match=f"is not an estimator: it has no {ESTIMATOR_FILE}"):
        load_estimator(tmp_path)
