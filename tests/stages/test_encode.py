"""Features by a network that is not trained: computed once, learned from like any column, and the same when acting."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
import torch
from pydantic import ValidationError
from safetensors.torch import save_file

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.demonstration.ingestion import IngestionConfig
from juicer.demonstration.log import write_log
from juicer.policy.backbone import build_backbone
from juicer.policy.backbones.patch_cnn.config import PatchCNNConfig
from juicer.policy.checkpoint import load_checkpoint, load_policy
from juicer.policy.config import PolicyConfig
from juicer.policy.network import build_policy
from juicer.rollout import rollout
from juicer.storage.columns import ColumnReader
from juicer.storage.episodes import EpisodeReader
from juicer.storage.selections import SelectionRow, write_selection
from juicer.training.config import TrainingConfig
from juicer.training.mixing import DatasetConfig
from juicer.views import View
from stages.dataset import dataset
from stages.encode import EncodeConfig, encode
from stages.ingest import ingest
from stages.render import RenderConfig, render
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session
from stages.train import TrainConfig, train

VIEWS = {"front": View(camera="front", width=32, height=32), "wrist": View(camera="wrist", width=32, height=32)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where a file of weights lies."""
    folder = tmp_path_factory.mktemp("weights")
    torch.manual_seed(0)
    save_file(build_backbone(PatchCNNConfig(), (32, 32)).state_dict(), folder / "small.safetensors")
    return folder


def policy_on(weights) -> PolicyConfig:
    backbone = {"kind": "patch_cnn", "weights": weights}
    eyes = {"kind": "images", "views": VIEWS, "backbone": backbone, "frozen": True, "projection": 8}
    return PolicyConfig.model_validate(
        {
            "horizons": {"obs": 2, "pred": 8, "action": 4},
            "observation": {"body": {"kind": "proprioception"}, "eyes": eyes},
            "head": {"kind": "mlp", "width": 32, "blocks": 1},
        }
    )


@pytest.fixture(scope="module")
def policy(folder):
    digest = hashlib.sha256((folder / "small.safetensors").read_bytes()).hexdigest()
    return policy_on({"file": "small.safetensors", "sha256": digest, "licence": "MIT"})


@pytest.fixture(scope="module")
def made(drawing, folder, policy, tmp_path_factory, recording, second_recording):
    """The session, the images and the features of each view, and the checkpoint."""
    logs = tmp_path_factory.mktemp("logs")
    write_log(logs / "0.npz", recording)
    write_log(logs / "1.npz", second_recording)
    session = Session(ArtifactStore(tmp_path_factory.mktemp("store")), perform_here, machine=Machine(weights=folder))
    episodes = ingest(session, files=(logs / "0.npz", logs / "1.npz"), config=IngestionConfig(task="one_leg"))
    images, features = [], []
    for part in policy.fixed_parts:
        drawn = tuple(render(session, episodes=episodes, config=RenderConfig(view=view)) for view in part.views_seen)
        images += drawn
        features.append(encode(session, episodes=episodes, config=EncodeConfig(encoder=part)))
    mixed = dataset(session, episodes=(episodes,), columns=tuple(features), config=DatasetConfig())
    training = TrainingConfig(steps=6, batch_size=16, warmup_steps=2, validation_fraction=0.5)
    checkpoint = train(session, dataset=mixed, config=TrainConfig(policy=policy, training=training))
    return session, images, features, checkpoint


def test_a_policy_learns_from_features_and_acts_on_images(made, policy):
    session, images, _, checkpoint = made
    summary = session.store.manifest(checkpoint).summary
    assert summary["observes"] == "images"
    assert summary["drawn_by"] == session.store.manifest(images[0]).summary["drawn_by"]
    acting = load_policy(session.store.open(checkpoint), "one_leg")
    assert {spec.name for spec in acting.observations} == {"proprioception", *(view.name for view in VIEWS.values())}
    (episode,) = rollout(acting, "one_leg", "low", [0], num_envs=1, max_steps=8)
    assert len(episode) == 8


def test_features_say_how_many_they_are(made):
    session, _, features, _ = made
    summary = session.store.manifest(features[0]).summary
    (spec,) = ColumnReader(session.store.open(features[0])).schema
    assert summary["headline"] == f"{summary['steps']} steps, {spec.shape[0]} features each"


def test_features_in_training_are_those_when_acting(made, policy):
    session, images, features, checkpoint = made
    stored = load_checkpoint(session.store.open(checkpoint))
    network = build_policy(policy, stored.metadata.tasks, seed=0)
    network.load_state_dict(dict(stored.weights))
    encoder = network.eval().encoders.members[1]
    seen, columns = {}, {}
    for drawn, computed in zip(images, features, strict=True):
        for ref, found in ((drawn, seen), (computed, columns)):
            reader = ColumnReader(session.store.open(ref))
            (name,) = reader.schema.names()
            found[name] = torch.from_numpy(reader.steps(name, slice(0, 12)))
    learned = encoder.prepare(columns)
    assert learned.keys() == VIEWS.keys()
    for name, values in encoder.prepare(encoder.derive(seen)).items():
        np.testing.assert_allclose(values, learned[name], rtol=1e-4, atol=1e-5)


def test_of_rollouts_that_a_selection_judges_only_those_kept_are_seen(made, policy):
    session, _, features, _ = made
    reader = EpisodeReader(
        session.store.open(ArtifactRef("episodes", ColumnReader(session.store.open(features[0])).artifact))
    )
    records = reader.records
    with session.store.create(Recipe("by hand", "selection")) as draft:
        write_selection(draft.path, [SelectionRow(records[0].episode_id, keep=False, reason="failed")])
    judged = {"episodes": ArtifactRef("episodes", reader.folder.name), "selections": (draft.ref,)}
    computed = encode(session, **judged, config=EncodeConfig(encoder=policy.fixed_parts[0]))
    assert ColumnReader(session.store.open(computed)).covered.tolist() == [False, True]
    assert session.store.manifest(computed).summary["steps"] == reader.lengths[1]


def test_what_is_learned_shares_no_features_and_what_is_computed_does(policy):
    wider = policy.model_copy(deep=True)
    eyes = wider.observation["eyes"].model_copy(update={"projection": 32})
    wider = wider.model_copy(update={"observation": {"other": eyes}})
    assert wider.fixed_parts == policy.fixed_parts
    assert policy.learned_views == ()


def test_what_learns_has_no_features_to_keep(policy):
    trained = policy.observation["eyes"].model_copy(update={"frozen": False})
    with pytest.raises(ValidationError, match="an encoder 'images' that is not frozen has no features to keep"):
        EncodeConfig(encoder=trained)
