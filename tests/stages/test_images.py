"""From images to actions: columns become windows, windows a policy, and it is shown in rollouts what it has learned."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from juicer import api
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.demonstration.ingestion import IngestionConfig
from juicer.demonstration.log import write_log
from juicer.errors import ArtifactError, InvalidObservation, UnusableWeights
from juicer.policy.checkpoint import load_policy
from juicer.policy.config import PolicyConfig
from juicer.policy.served import _load_pyfunc
from juicer.rollout import rollout
from juicer.storage.columns import ColumnReader, write_columns
from juicer.storage.dataset import read_dataset
from juicer.storage.episodes import EpisodeReader
from juicer.storage.evaluations import read_evaluation
from juicer.storage.selections import SelectionRow, write_selection
from juicer.training.config import TrainingConfig
from juicer.training.mixing import DatasetConfig
from juicer.views import GazeCrop, View
from stages.collect import CollectConfig, collect
from stages.dataset import dataset
from stages.evaluate import EvaluateConfig, evaluate
from stages.ingest import ingest
from stages.monitor import MonitorConfig, monitor
from stages.render import RenderConfig, render
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session
from stages.train import TrainConfig, train

GAZE = View(camera="front", crop=GazeCrop(), width=24, height=32)
WRIST = View(camera="wrist", width=32, height=24)
CNN = {"kind": "patch_cnn"}
POLICY = PolicyConfig.model_validate(
    {
        "horizons": {"obs": 2, "pred": 8, "action": 4},
        "action_frame": "relative",
        "observation": {
            "body": {"kind": "proprioception"},
            "eyes": {"kind": "images", "views": {"gaze": GAZE, "wrist": WRIST}, "backbone": CNN, "projection": 8},
        },
        "head": {"kind": "mlp", "width": 32, "blocks": 1},
    }
)
TRAINING = TrainingConfig(
    steps=6, batch_size=16, warmup_steps=2, validation_fraction=0.5, validate_every=3, report_every=2, save_every=2
)
TRAIN = TrainConfig(policy=POLICY, training=TRAINING)
EVALUATE = EvaluateConfig(task="one_leg", randomness="low", episodes=3, max_steps=12)


@dataclass(frozen=True)
class Looking:
    """What a policy that looks is made of."""

    store: ArtifactStore
    demonstrations: ArtifactRef
    columns: tuple[ArtifactRef, ...]
    dataset: ArtifactRef
    checkpoint: ArtifactRef

    def session(self, num_envs: int = 2) -> Session:
        return Session(self.store, perform_here, machine=Machine(num_envs=num_envs))

    def summary(self, ref):
        return self.store.manifest(ref).summary


@pytest.fixture(scope="module")
def looking(drawing, tmp_path_factory, recording, second_recording):
    folder = tmp_path_factory.mktemp("logs")
    write_log(folder / "0.npz", recording)
    write_log(folder / "1.npz", second_recording)
    store = ArtifactStore(tmp_path_factory.mktemp("store"))
    session = Session(store, perform_here)
    demonstrations = ingest(session, files=(folder / "0.npz", folder / "1.npz"), config=IngestionConfig(task="one_leg"))
    views = POLICY.learned_views
    columns = tuple(render(session, episodes=demonstrations, config=RenderConfig(view=view)) for view in views)
    mixed = dataset(session, episodes=(demonstrations,), columns=columns, config=DatasetConfig())
    return Looking(store, demonstrations, columns, mixed, train(session, dataset=mixed, config=TRAIN))


def test_a_policy_learns_from_the_images_of_its_views_and_says_so(looking):
    summary = looking.summary(looking.checkpoint)
    assert summary["observes"] == "images"
    assert summary["drawn_by"] == looking.summary(looking.columns[0])["drawn_by"]
    assert np.isfinite(summary["train/loss"])
    assert np.isfinite(summary["validation/loss"])
    assert {row.columns for row in read_dataset(looking.store.open(looking.dataset))} == {
        tuple(ref.id for ref in looking.columns)
    }


def test_it_acts_alike_however_many_episodes_run_beside_it(looking):
    policy = load_policy(looking.store.open(looking.checkpoint), "one_leg")
    assert {spec.name for spec in policy.observations} == {"proprioception", GAZE.name, WRIST.name}
    seeds = range(3)
    alone, together = (
        list(rollout(policy, "one_leg", "low", seeds, num_envs=number, max_steps=12)) for number in (1, 3)
    )
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one.steps["action"], other.steps["action"])


def test_its_evaluation_says_what_it_saw(looking):
    evaluation = evaluate(looking.session(), checkpoint=looking.checkpoint, config=EVALUATE)
    summary = looking.summary(evaluation)
    assert summary["observes"] == "images"
    assert summary["headline"].endswith("), from images")
    assert "finding" not in summary
    assert len(read_evaluation(looking.store.open(evaluation))) == 3


def test_a_notebook_is_told_what_it_saw(looking):
    evaluation = evaluate(looking.session(), checkpoint=looking.checkpoint, config=EVALUATE)
    assert api.load_evaluation(looking.store, evaluation.id).observes == "images"
    policy = api.load_policy(looking.store, looking.checkpoint.id)
    assert str(api.evaluate(policy, "one_leg", episodes=1, max_steps=2)).endswith(", from images")


@pytest.fixture
def elsewhere(monkeypatch):
    """A machine whose renderer is another one."""
    monkeypatch.setattr("juicer.renderers.gl_name", lambda: "another")


def told_of_another(looking):
    drawn_by = looking.summary(looking.checkpoint)["drawn_by"][0]
    return f"it saw images drawn by another, and had learned from those of {drawn_by}"


def test_what_another_renderer_drew_is_told_also_of_an_evaluation_that_began_there(looking, elsewhere, monkeypatch):
    one, two = (EVALUATE.model_copy(update={"episodes": number, "anytime": True}) for number in (1, 2))
    begun = evaluate(looking.session(), checkpoint=looking.checkpoint, config=one)
    monkeypatch.undo()
    whole = evaluate(looking.session(), checkpoint=looking.checkpoint, previous=begun, config=two)
    assert {looking.summary(ref)["finding"] for ref in (begun, whole)} == {told_of_another(looking)}
    own = looking.summary(looking.checkpoint)["drawn_by"]
    assert [looking.summary(ref)["drawn_by"] for ref in (begun, whole)] == [["another"], sorted(["another", *own])]


def test_what_another_renderer_drew_is_told_of_rollouts_and_of_a_monitor(looking, elsewhere):
    scene = {"task": "one_leg", "randomness": "low", "max_steps": 12}
    collected = collect(
        looking.session(), checkpoint=looking.checkpoint, config=CollectConfig(**scene, successes=1, max_episodes=1)
    )
    assert looking.summary(collected)["finding"] == told_of_another(looking)
    head = {"kind": "flow", "denoiser": {"kind": "mlp", "width": 32, "blocks": 1}}
    policy = PolicyConfig.model_validate({**POLICY.model_dump(), "head": head})
    drawing_samples = train(
        looking.session(), dataset=looking.dataset, config=TrainConfig(policy=policy, training=TRAINING)
    )
    config = MonitorConfig(**scene, episodes=1, watched_samples=2)
    watched = monitor(looking.session(), checkpoint=drawing_samples, config=config)
    assert looking.summary(watched)["finding"].endswith(f"; {told_of_another(looking)}")


def test_images_of_two_renderers_are_learned_from_and_told(looking):
    session, (gaze, wrist) = looking.session(), looking.columns
    drawn = ColumnReader(looking.store.open(wrist))
    with looking.store.create(Recipe("by hand", "columns")) as draft:
        ends = drawn.episode_ends
        images = ({WRIST.name: each} for each in np.split(drawn.steps(WRIST.name), ends[:-1]))
        write_columns(
            draft.path, [WRIST.column], images, artifact=drawn.artifact, episode_ends=ends, drawn_by=["another"]
        )
    mixed = dataset(session, episodes=(looking.demonstrations,), columns=(gaze, draft.ref), config=DatasetConfig())
    finding = looking.summary(train(session, dataset=mixed, config=TRAIN))["finding"]
    assert finding.startswith("some of its images were drawn by another and others by ")


def test_it_is_retrained_on_the_images_of_the_rollouts_that_are_kept(looking):
    session = looking.session()
    config = CollectConfig(task="one_leg", randomness="low", successes=2, max_episodes=2, max_steps=12)
    rollouts = collect(session, checkpoint=looking.checkpoint, config=config)
    left, kept = EpisodeReader(looking.store.open(rollouts)).ids
    with looking.store.create(Recipe("by hand", "selection", inputs={"episodes": (rollouts,)})) as chosen:
        write_selection(chosen.path, [SelectionRow(left, False, "too long"), SelectionRow(kept, True, "")])
    images = tuple(
        render(session, episodes=rollouts, selections=(chosen.ref,), config=RenderConfig(view=view))
        for view in POLICY.learned_views
    )
    mixed = dataset(
        session,
        episodes=(looking.demonstrations, rollouts),
        selections=(chosen.ref,),
        columns=(*looking.columns, *images),
        config=DatasetConfig(),
    )
    retrained = looking.summary(train(session, dataset=mixed, config=TRAIN))
    assert retrained["episodes"] == {"teleop": 2, "rollout": 1}
    assert [looking.summary(ref)["images"] for ref in images] == [retrained["timesteps"]["rollout"]] * 2


def test_a_dataset_without_the_images_of_a_view_is_refused(looking):
    less = dataset(
        looking.session(), episodes=(looking.demonstrations,), columns=looking.columns[:1], config=DatasetConfig()
    )
    with pytest.raises(ArtifactError, match=r"looks at wrist whole 32x24, and the dataset has no such images"):
        train(looking.session(), dataset=less, config=TRAIN)


def test_weights_of_another_network_are_refused_before_images_are_unpacked(looking, tmp_path, monkeypatch):
    save_file({"conv1.weight": torch.zeros(3)}, tmp_path / "mine.safetensors")
    digest = hashlib.sha256((tmp_path / "mine.safetensors").read_bytes()).hexdigest()
    weights = {"file": "mine.safetensors", "sha256": digest, "licence": "MIT"}
    eyes = {"kind": "images", "views": {"gaze": GAZE, "wrist": WRIST}, "backbone": {**CNN, "weights": weights}}
    observation = {"body": {"kind": "proprioception"}, "eyes": eyes}
    policy = PolicyConfig.model_validate({**POLICY.model_dump(), "observation": observation})
    monkeypatch.setattr("stages.train.unpack_images", lambda *_: pytest.fail("images were unpacked"))
    session = Session(looking.store, perform_here, machine=Machine(weights=tmp_path))
    with pytest.raises(UnusableWeights, match="holds the weights of another network"):
        train(session, dataset=looking.dataset, config=TrainConfig(policy=policy, training=TRAINING))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda image: image[:, :, 1:], r"must have shape \(1, 2, 32, 24, 3\)"),
        (lambda image: image.astype(np.float32) * np.nan, "must be of type uint8, got float32"),
        (None, "needs '"),
    ],
    ids=["another size", "NaN pixels", "another camera"],
)
def test_images_that_it_was_not_trained_with_are_refused(looking, rng, change, words):
    policy = load_policy(looking.store.open(looking.checkpoint), "one_leg")
    seen = {"proprioception": np.zeros((1, 2, 16), np.float32)}
    for view in (GAZE, WRIST):
        seen[view.name] = np.zeros((1, 2, view.height, view.width, 3), np.uint8)
    gaze = seen.pop(GAZE.name)
    other = {GAZE.name: change(gaze)} if change else {View(camera="front").name: gaze}
    with pytest.raises(InvalidObservation, match=words):
        policy.predict(seen | other, [rng])


def test_it_is_served_images_as_arrays_or_as_the_numbers_of_json(looking):
    rng = np.random.default_rng(0)
    seen = {"proprioception": rng.normal(size=(1, 2, 16))}
    for view in (GAZE, WRIST):
        seen[view.name] = rng.integers(0, 256, (1, 2, view.height, view.width, 3), dtype=np.uint8)
    served, again = (_load_pyfunc(str(looking.store.open(looking.checkpoint)), {"task": "one_leg"}) for _ in range(2))
    actions = served.predict(seen)
    assert actions.shape == (1, 4, 10)
    np.testing.assert_array_equal(actions, again.predict({name: values.tolist() for name, values in seen.items()}))
