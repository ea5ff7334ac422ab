"""Analyses of a small policy that draws samples, from its checkpoint to what the report shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from juicer.analysis.watching import sampling_policy, seen_at
from juicer.annotation.propose import AnnotationConfig
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.demonstration.ingestion import IngestionConfig
from juicer.demonstration.log import write_log
from juicer.errors import ConfigError
from juicer.policy.checkpoint import load_policy
from juicer.policy_rollout import roll_out
from juicer.reporting.analyses import shown_analysis
from juicer.rollout import rollout
from juicer.storage.analyses import read_modes, read_monitor, read_samples
from juicer.storage.evaluations import read_evaluation
from juicer.training.config import TrainingConfig
from juicer.training.mixing import DatasetConfig
from stages.annotate import annotate
from stages.dataset import dataset
from stages.evaluate import EvaluateConfig, evaluate
from stages.ingest import ingest
from stages.memorise import MemoriseConfig, memorise
from stages.modes import ModesConfig, modes
from stages.monitor import MonitorConfig, monitor
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session
from stages.sampling import SamplingConfig, sampling
from stages.train import TrainConfig, train

POLICY = {
    "horizons": {"obs": 2, "pred": 8, "action": 4},
    "action_frame": "relative",
    "head": {"kind": "flow", "denoiser": {"kind": "mlp", "width": 32, "blocks": 1}},
}
TRAINING = TrainingConfig(steps=4, batch_size=16, warmup_steps=2, validation_fraction=0, report_every=4, save_every=4)
ROLLOUTS = {"task": "one_leg", "randomness": "low", "episodes": 2, "max_steps": 11}
EVALUATE = EvaluateConfig(**ROLLOUTS)


@dataclass(frozen=True)
class Learned:
    session: Session
    demonstrations: ArtifactRef
    annotations: ArtifactRef
    checkpoint: ArtifactRef

    @property
    def store(self) -> ArtifactStore:
        return self.session.store


@pytest.fixture(scope="module")
def learned(tmp_path_factory, recording):
    folder = tmp_path_factory.mktemp("logs")
    write_log(folder / "0.npz", recording)
    session = Session(ArtifactStore(tmp_path_factory.mktemp("store")), perform_here, machine=Machine(num_envs=2))
    demonstrations = ingest(session, files=(folder / "0.npz",), config=IngestionConfig(task="one_leg"))
    annotations = annotate(session, episodes=demonstrations, config=AnnotationConfig())
    mixed = dataset(session, episodes=(demonstrations,), config=DatasetConfig())
    checkpoint = train(session, dataset=mixed, config=TrainConfig(policy=POLICY, training=TRAINING))
    return Learned(session, demonstrations, annotations, checkpoint)


def summary(learned, ref):
    return learned.store.manifest(ref).summary


def draw(learned, **settings):
    return sampling(
        learned.session,
        checkpoint=learned.checkpoint,
        episodes=learned.demonstrations,
        annotations=learned.annotations,
        config=SamplingConfig(task="one_leg", samples=50, inference_steps=(4, 1), **settings),
    )


def test_samples_are_drawn_before_the_insertion_and_compared_with_those_of_the_most_steps(learned):
    ref = draw(learned)
    samples = read_samples(learned.store.open(ref))
    assert {steps: values.shape for steps, values in samples.items()} == {1: (50, 7), 4: (50, 7)}
    facts = summary(learned, ref)
    assert facts["reference_steps"] == 4
    assert set(facts["distances"]) == {"1", "chance"}
    shown = shown_analysis(learned.store, ref, "fig4: BC, seed 0")
    assert [row[0] for row in shown.rows] == ["1", "chance"]
    assert shown.png.startswith(b"\x89PNG")
    assert summary(learned, draw(learned, steps_before=0))["step"] == facts["step"] + 10


def test_an_analysis_of_what_another_renderer_drew_is_shown_with_a_note(learned, monkeypatch):
    monkeypatch.setattr("stages.sampling.renderer_facts", lambda *_: {"finding": "it saw images drawn by another"})
    shown = shown_analysis(learned.store, draw(learned, seed=7), "")
    assert shown.sentence.endswith(" Note: it saw images drawn by another.")
    assert shown.png


def test_a_critical_state_that_no_demonstration_has_is_a_finding(learned):
    ref = draw(learned, critical_state=5)
    assert "no demonstration has the critical state" in summary(learned, ref)["finding"]
    assert shown_analysis(learned.store, ref, "").sentence == f"{summary(learned, ref)['finding']}."


def test_a_monitor_watches_the_same_rollouts_as_an_evaluation_and_changes_none(learned):
    evaluation = evaluate(learned.session, checkpoint=learned.checkpoint, config=EVALUATE)
    config = MonitorConfig(**ROLLOUTS, watched_samples=4)
    watched = monitor(learned.session, checkpoint=learned.checkpoint, config=config)
    rows = read_monitor(learned.store.open(watched))
    ends = {(row.seed, row.outcome, row.length) for row in rows}
    assert ends == {
        (row.seed, row.outcome.value, row.length) for row in read_evaluation(learned.store.open(evaluation))
    }
    assert [row.step for row in rows] == [0, 4, 8, 0, 4, 8]
    assert all(row.position_mm > 0 for row in rows)
    assert "there is no success" in summary(learned, watched)["finding"]


def test_what_a_policy_saw_is_read_off_the_episode_as_it_was_shown(learned):
    folder = learned.store.open(learned.checkpoint)
    policy = sampling_policy(load_policy(folder, "one_leg"))
    seen = []

    class Noting:
        observations, obs_horizon, action_horizon = policy.observations, policy.obs_horizon, policy.action_horizon

        def predict(self, observations, streams):
            seen.append({name: values[0].copy() for name, values in observations.items()})
            return policy.predict(observations, streams)

    (episode,) = rollout(Noting(), "one_leg", "low", [3_000_000], num_envs=1, max_steps=11)
    again = seen_at(policy, episode, range(0, len(episode), policy.action_horizon))
    for place, observations in enumerate(seen):
        for name, values in observations.items():
            np.testing.assert_array_equal(again[name][place], values)


def test_an_episode_that_acts_on_the_densest_sample_depends_on_none_beside_it(learned):
    folder, config = learned.store.open(learned.checkpoint), EVALUATE.model_copy(update={"samples": 8})
    seeds = [3_000_000, 3_000_001, 3_000_002]
    together = list(roll_out(folder, "", config, seeds, num_envs=3))
    for seed, episode in zip(seeds, together, strict=True):
        (alone,) = roll_out(folder, "", config, [seed], num_envs=1)
        np.testing.assert_array_equal(alone.steps["action"], episode.steps["action"])


def test_success_and_cost_are_compared_by_the_number_of_samples(learned):
    evaluations = tuple(
        evaluate(
            learned.session, checkpoint=learned.checkpoint, config=EVALUATE.model_copy(update={"samples": samples})
        )
        for samples in (1, 8)
    )
    config = ModesConfig(task="one_leg", predictions=2)
    ref = modes(learned.session, checkpoint=learned.checkpoint, evaluations=evaluations, config=config)
    rows = read_modes(learned.store.open(ref))
    assert [(row.samples, row.episodes, row.p_value) for row in rows] == [(1, 2, 1.0), (8, 2, 1.0)]
    assert all(row.chunk_ms > 0 for row in rows)
    assert [row[0] for row in shown_analysis(learned.store, ref, "").rows] == ["1", "8"]
    with pytest.raises(ConfigError, match="two of the evaluations are of 1 samples"):
        modes(
            learned.session,
            checkpoint=learned.checkpoint,
            evaluations=(evaluations[0], evaluations[0]),
            config=config,
        )


def test_a_replay_has_no_samples_to_analyse(learned):
    replay = memorise(learned.session, episodes=learned.demonstrations, config=MemoriseConfig())
    with pytest.raises(ConfigError, match="it has no samples to analyse"):
        monitor(learned.session, checkpoint=replay, config=MonitorConfig(**ROLLOUTS))
    with pytest.raises(ConfigError, match="a replay has no samples to choose among"):
        evaluate(learned.session, checkpoint=replay, config=EVALUATE.model_copy(update={"samples": 2}))
