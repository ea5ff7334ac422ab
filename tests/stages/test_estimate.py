"""An estimator as a stage of the loop: from demonstrations to a policy that acts on images."""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import save

from benchmarks import image_control
from juicer.annotation.propose import AnnotationConfig
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore
from juicer.demonstration.ingestion import IngestionConfig
from juicer.demonstration.log import write_log
from juicer.errors import ArtifactError, ConfigError, NothingLeft, UnusableWeights
from juicer.imaging import recorded
from juicer.policy.backbones.patch_cnn.config import PatchCNNConfig
from juicer.policy.backbones.resnet.config import ResNetConfig
from juicer.policy.checkpoint import load_policy
from juicer.policy.encoders.estimated.config import EstimatedConfig, EstimatorConfig
from juicer.policy.encoders.estimated.files import load_estimator
from juicer.reporting.comparison import ReportRow
from juicer.reporting.seen import views_of
from juicer.sim.sections import joint_positions
from juicer.storage.columns import ColumnReader
from juicer.storage.episodes import EpisodeReader, write_episodes
from juicer.training.config import TrainingConfig
from juicer.training.mixing import DatasetConfig
from juicer.views import View
from stages.annotate import annotate
from stages.dataset import dataset
from stages.encode import EncodeConfig, encode
from stages.estimate import EstimateConfig, estimate
from stages.evaluate import EvaluateConfig, evaluate
from stages.ingest import ingest
from stages.report import ReportConfig, report
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session
from stages.train import TrainConfig, train

pytestmark = pytest.mark.usefixtures("drawing")

ENCODER = EstimatedConfig(
    estimator=EstimatorConfig(
        views={"front": View(camera="front", width=32, height=24), "wrist": View(camera="wrist", width=16, height=16)},
        backbone=PatchCNNConfig(quarter=8, eighth=8, quarter_blocks=0, eighth_blocks=1, maps=4),
        width=16, states=70, steps=4, batch_size=8, threads=1,
    )
)  # fmt: skip
TRAIN = TrainConfig(
    policy={
        "horizons": {"obs": 1, "pred": 8, "action": 4},
        "observation": {"state": ENCODER},
        "head": {"kind": "mlp", "width": 16, "blocks": 1},
    },
    training=TrainingConfig(steps=4, batch_size=16, warmup_steps=2, validation_fraction=0.5, ema_decay=0.9),
)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    return Session(
        ArtifactStore(tmp_path_factory.mktemp("store")), perform_here, machine=Machine(num_envs=2, workers=2)
    )


@pytest.fixture(scope="module")
def demonstrations(session, tmp_path_factory, recording, second_recording):
    folder = tmp_path_factory.mktemp("logs")
    for number, log in enumerate((recording, second_recording)):
        write_log(folder / f"{number}.npz", log)
    return ingest(session, files=tuple(sorted(folder.iterdir())), config=IngestionConfig(task="one_leg"))


@pytest.fixture(scope="module")
def estimator(session, demonstrations):
    annotations = annotate(session, episodes=demonstrations, config=AnnotationConfig())
    return estimate(session, episodes=demonstrations, annotations=annotations, config=EstimateConfig(encoder=ENCODER))


@pytest.fixture(scope="module")
def estimates(session, demonstrations, estimator):
    return encode(session, episodes=demonstrations, estimators=(estimator,), config=EncodeConfig(encoder=ENCODER))


@pytest.fixture(scope="module")
def learned_from(session, demonstrations, estimates):
    return dataset(session, episodes=(demonstrations,), columns=(estimates,), config=DatasetConfig())


def test_it_tells_its_error_at_every_critical_state(session, estimator):
    facts = session.store.manifest(estimator).summary
    assert facts["task"] == "one_leg"
    assert facts["states"] == 70
    assert facts["error_mm"]["insert leg"] > 0
    assert facts["error_deg"]["insert leg"] > 0
    assert facts["validation/loss"] > 0
    assert facts["device"] == "cpu"
    assert facts["precision"] in ("fp32", "bf16")
    assert re.fullmatch(r"70 states; off by [0-9.]+ mm at insert leg", facts["headline"])


def test_weights_of_another_network_are_refused_before_anything_is_drawn(
    session, demonstrations, tmp_path, monkeypatch
):
    content = save({"conv1.weight": torch.zeros(3)})
    (tmp_path / "mine.safetensors").write_bytes(content)
    weights = {"file": "mine.safetensors", "sha256": hashlib.sha256(content).hexdigest(), "licence": "MIT"}
    backbone = ResNetConfig.model_validate({"weights": weights})
    wrong = ENCODER.model_copy(update={"estimator": ENCODER.estimator.model_copy(update={"backbone": backbone})})
    here = replace(session, machine=replace(session.machine, weights=tmp_path))
    annotations = annotate(session, episodes=demonstrations, config=AnnotationConfig())
    monkeypatch.setattr("juicer.estimation.drawing.draw_states", None)
    with pytest.raises(UnusableWeights, match="holds the weights of another network"):
        estimate(here, episodes=demonstrations, annotations=annotations, config=EstimateConfig(encoder=wrong))


def test_an_estimator_is_a_loadable_product_of_its_own(session, estimator):
    assert load_estimator(session.store.open(estimator, "estimator")).config == ENCODER


def test_a_policy_learns_from_what_the_estimator_sees_and_acts_on_that(session, estimator, learned_from):
    checkpoint = train(session, dataset=learned_from, estimators=(estimator,), config=TRAIN)
    facts = session.store.manifest(checkpoint).summary
    assert facts["observes"] == "images, poses in training"
    assert facts["drawn_by"] == session.store.manifest(estimator).summary["drawn_by"]
    policy = load_policy(session.store.open(checkpoint, "checkpoint"), "one_leg")
    assert "part_poses" not in [spec.name for spec in policy.observations]
    config = EvaluateConfig(task="one_leg", randomness="low", episodes=2, max_steps=8)
    evaluation = evaluate(session, checkpoint=checkpoint, config=config)
    assert session.store.manifest(evaluation).summary["episodes"] == 2
    assert views_of(session.store, evaluation) == tuple(ENCODER.estimator.views.values())
    rows = (ReportRow(condition="bc", title="BC", seed=0),)
    page = report(session, evaluations=(evaluation,), config=ReportConfig(title="t", task="one_leg", rows=rows))
    text = (session.store.open(page, "report") / "report.html").read_text()
    assert "Below: what the policy saw." in text
    assert "What is read off images" in text
    assert f"one_leg: front, wrist ({estimator.id[:6]})" in text


def test_an_estimator_is_not_learned_from_nothing(session, demonstrations):
    annotations = annotate(session, episodes=demonstrations, config=AnnotationConfig())
    with session.store.create(Recipe("by hand", "episodes")) as draft:
        write_episodes(draft.path, (), {}, may_be_empty=True)
    with pytest.raises(NothingLeft, match="an estimator needs two demonstrations"):
        estimate(session, episodes=draft.ref, annotations=annotations, config=EstimateConfig(encoder=ENCODER))


def noted_steps(monkeypatch):
    """The steps of the other episode of which images are drawn in the view of the wrist, as they are drawn."""
    steps = []

    class Noting(image_control.ViewRenderer):
        known = ()

        def draw(self, positions, view, end_effector):
            if view.camera == "wrist":
                steps.append(self.known.index(positions.tobytes()))
            return super().draw(positions, view, end_effector)

    def noted(task, states):
        found = joint_positions(task, states)
        Noting.known = [each.tobytes() for each in found]
        return found

    monkeypatch.setattr(image_control, "ViewRenderer", Noting)
    monkeypatch.setattr(image_control, "joint_positions", noted)
    return steps


def test_the_control_shows_every_episode_the_images_of_another_from_its_first_step_on(
    session, estimator, learned_from, demonstrations, monkeypatch, capsys
):
    checkpoint = train(session, dataset=learned_from, estimators=(estimator,), config=TRAIN)
    few = ("--episodes", "6", "--envs", "1", "--max-steps", "8", "--data", session.store.url)
    monkeypatch.setattr("sys.argv", ["image_control", checkpoint.id, demonstrations.id, *few])
    steps = noted_steps(monkeypatch)
    image_control.main()
    own, other = capsys.readouterr().out.splitlines()
    assert own.startswith("its own images     0 of 6")
    assert other.startswith("another episode's  0 of 6")
    assert steps == 6 * [0, 4]


def test_a_policy_that_estimates_is_not_trained_without_its_estimator(session, estimator, learned_from, demonstrations):
    with pytest.raises(
        ConfigError, match=rf"holds what {estimator} reads off images, and the policy is not given that"
    ):
        train(session, dataset=learned_from, config=TRAIN)
    bare = dataset(session, episodes=(demonstrations,), config=DatasetConfig())
    with pytest.raises(ArtifactError, match=r"learns from 'estimated_.*make the column by the stage 'encode'"):
        train(session, dataset=bare, estimators=(estimator,), config=TRAIN)


def test_nothing_is_estimated_of_no_episode(session, estimator):
    with session.store.create(Recipe("none", "episodes")) as draft:
        write_episodes(draft.path, (), {}, may_be_empty=True)
    with pytest.raises(NothingLeft, match="none is wanted, so there is nothing to draw"):
        encode(session, episodes=draft.ref, estimators=(estimator,), config=EncodeConfig(encoder=ENCODER))


def test_nothing_is_estimated_without_an_estimator(session, demonstrations):
    with pytest.raises(ConfigError, match="make one by the stage 'estimate'"):
        encode(session, episodes=demonstrations, config=EncodeConfig(encoder=ENCODER))


def test_what_was_estimated_for_a_training_is_what_the_estimator_sees(session, estimator, estimates, demonstrations):
    columns, reader = ColumnReader(session.store.open(estimates)), EpisodeReader(session.store.open(demonstrations))
    span = slice(20, 30)
    seen = {"proprioception": torch.from_numpy(reader.steps("proprioception", span))}
    with recorded.drawing_of(reader, ENCODER.views_seen, workers=1, chosen=[0]) as drawing:
        (images,) = drawing.episodes()
    seen |= {name: torch.from_numpy(values[span]) for name, values in images.items()}
    wanted = load_estimator(session.store.open(estimator))(seen)[:, 16:]
    np.testing.assert_allclose(columns.steps(ENCODER.column, span), wanted, rtol=1e-4, atol=1e-5)
