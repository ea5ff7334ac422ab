"""Every stage in miniature, each fed by the ones before it, as in the loop."""

from __future__ import annotations

import base64
import json
import shutil
from dataclasses import dataclass, replace

import av
import numpy as np
import pytest

from flows.annotations import annotations_of
from flows.command.evaluated import evaluated_row, kept_episode, recomputed_episode
from flows.loop_config import LoopConfig
from flows.stopping import StopConfig, measure_alone
from juicer.annotation.propose import AnnotationConfig
from juicer.annotation.versions import Entry, save, versions_path
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.augmentation.config import ToleranceConfig
from juicer.config import read_mapping
from juicer.demonstration.ingestion import IngestionConfig
from juicer.demonstration.log import write_log
from juicer.demonstration.recording import Sitting, minutes_of
from juicer.episode import SIMULATOR, Outcome, Role, Schema
from juicer.errors import (
    ArtifactError,
    ConfigError,
    EvaluationOnly,
    InvalidCheckpoint,
    InvalidLabels,
    InvalidObservation,
    NothingLeft,
    RenderingUnavailable,
    StateMissing,
    TrainingFailed,
    WrongArtifactKind,
)
from juicer.evaluation import anytime_interval
from juicer.expert.human import Human
from juicer.policy.checkpoint import load_policy
from juicer.policy.config import HorizonConfig
from juicer.reporting.comparison import ReportRow
from juicer.reporting.page import render_page
from juicer.reporting.report import gather
from juicer.reporting.sources import Sources
from juicer.rollout import rollout
from juicer.shifts import parse_shift
from juicer.sim.env import AssemblyEnv
from juicer.storage.annotations import read_annotations
from juicer.storage.curves import read_curves
from juicer.storage.episodes import EpisodeReader, write_episodes
from juicer.storage.evaluations import read_evaluation, write_evaluation
from juicer.storage.selections import read_selection
from juicer.study.effort import effort_section
from juicer.study.material import task_study
from juicer.study.rounds import rounds_section
from juicer.study.sections import sections
from juicer.training.config import TrainingConfig, WindowConfig
from juicer.training.mixing import DatasetConfig
from stages.annotate import annotate
from stages.augment import AugmentConfig, augment
from stages.collect import CollectConfig, collect
from stages.correct import CorrectConfig, correct
from stages.dataset import dataset
from stages.evaluate import EvaluateConfig, evaluate
from stages.ingest import ingest
from stages.memorise import MemoriseConfig, memorise
from stages.record import RecordConfig, record
from stages.report import ReportConfig, report
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session
from stages.select import SelectConfig, select
from stages.train import TrainConfig, train

POLICY = {
    "horizons": {"obs": 1, "pred": 8, "action": 4},
    "action_frame": "relative",
    "head": {"kind": "mlp", "width": 32, "blocks": 1},
}
TRAINING = TrainingConfig(
    steps=6, batch_size=16, warmup_steps=2, validation_fraction=0.5, validate_every=3, report_every=2, save_every=2
)
SCENE = {"task": "one_leg", "randomness": "low"}
INGEST = IngestionConfig(task="one_leg")
TRAIN = TrainConfig(policy=POLICY, training=TRAINING)
AUGMENT = AugmentConfig(num_snippets=2)
COLLECT = CollectConfig(**SCENE, successes=1, max_episodes=2, max_steps=12)
EVALUATE = EvaluateConfig(**SCENE, episodes=3, max_steps=12)


@dataclass(frozen=True)
class Loop:
    """The artifacts of one small loop."""

    session: Session
    demonstrations: ArtifactRef
    annotations: ArtifactRef
    corrective: ArtifactRef
    checkpoint: ArtifactRef
    rollouts: ArtifactRef
    evaluation: ArtifactRef

    @property
    def store(self) -> ArtifactStore:
        return self.session.store


@pytest.fixture(scope="module")
def logs(tmp_path_factory, recording, second_recording):
    folder = tmp_path_factory.mktemp("logs")
    write_log(folder / "0.npz", recording)
    write_log(folder / "1.npz", second_recording)
    return (folder / "0.npz", folder / "1.npz")


@pytest.fixture(scope="module")
def loop(tmp_path_factory, logs):
    session = Session(ArtifactStore(tmp_path_factory.mktemp("store")), perform_here, machine=Machine(num_envs=2))
    demonstrations = ingest(session, files=logs, config=INGEST)
    annotations = annotate(session, episodes=demonstrations, config=AnnotationConfig())
    corrective = augment(session, episodes=demonstrations, annotations=annotations, config=AUGMENT)
    checkpoint = learn(session, demonstrations, corrective)
    rollouts = collect(session, checkpoint=checkpoint, config=COLLECT)
    evaluation = evaluate(session, checkpoint=checkpoint, config=EVALUATE)
    return Loop(session, demonstrations, annotations, corrective, checkpoint, rollouts, evaluation)


def learn(session, *episodes, selections=(), config=TRAIN):
    """Train on a dataset of all that is given."""
    mixed = dataset(session, episodes=episodes, selections=selections, config=DatasetConfig())
    return train(session, dataset=mixed, config=config)


def summary(loop, ref):
    return loop.store.manifest(ref).summary


def test_second_loop_reuses_everything(loop, logs):
    before = loop.store.refs()
    session = replace(loop.session, machine=Machine(workers=2, num_envs=3), isolate=True)
    assert ingest(session, files=logs, config=INGEST) == loop.demonstrations
    assert learn(session, loop.demonstrations, loop.corrective) == loop.checkpoint
    assert evaluate(session, checkpoint=loop.checkpoint, config=EVALUATE) == loop.evaluation
    assert loop.store.refs() == before


def test_ingest_counts_what_it_keeps_and_names_what_it_rejects(loop, logs, tmp_path):
    broken = tmp_path / "broken.npz"
    broken.write_bytes(b"no log")
    ref = ingest(loop.session, files=(*logs, broken), config=INGEST)
    facts = summary(loop, ref)
    assert (facts["logs"], facts["episodes"], facts["rejected"]) == (3, 2, 1)
    assert "truncated or no operator log" in facts["rejections"]["broken.npz"]
    assert facts["operator_minutes"] == minutes_of(facts["steps"] + facts["idle_steps_dropped"])
    with pytest.raises(NothingLeft, match="no demonstration is left of 1 operator logs; the first reason: the file"):
        ingest(loop.session, files=(broken,), config=INGEST)


def test_annotations_name_the_critical_state_of_every_demonstration(loop):
    rows = read_annotations(loop.store.open(loop.annotations))
    assert [row.episode_id for row in rows] == list(EpisodeReader(loop.store.open(loop.demonstrations)).ids)
    assert summary(loop, loop.annotations)["authors"] == {"proposed": 2}


def test_labels_of_a_human_override(loop, tmp_path):
    labels = tmp_path / "labels.csv"
    first = EpisodeReader(loop.store.open(loop.demonstrations)).read(0)
    labels.write_text(f"recording,step,critical_state\n{first.record.log},{first.recorded_step(5)},0\n")
    ref = annotate(loop.session, episodes=loop.demonstrations, labels=labels, config=AnnotationConfig())
    first, second = read_annotations(loop.store.open(ref))
    assert (first.step, first.author, second.author) == (5, "human", "proposed")
    assert ref != loop.annotations


def test_what_people_agree_on_overrides_and_what_it_took_is_told(loop, tmp_path):
    reader = EpisodeReader(loop.store.open(loop.demonstrations))
    first, second = reader.read(0), reader.read(1)
    path = versions_path(tmp_path, "one_leg")
    said = {"critical_state": 0, "keys": 2, "seconds": 3.0, "tool": "juicer 0.1, page"}
    save(path, [Entry(episode=first.record.episode_id, step=first.recorded_step(5), after=0, author="Ada", **said)])
    save(path, [Entry(episode=second.record.episode_id, step=second.recorded_step(5), after=0, author="Ada", **said)])
    save(path, [Entry(episode=second.record.episode_id, step=second.recorded_step(50), after=2, author="Bob", **said)])
    save(path, [Entry(episode="f" * 16, step=3, after=0, author="Bob", **said)])
    ref = annotate(loop.session, episodes=loop.demonstrations, labels=path, config=AnnotationConfig())
    rows = read_annotations(loop.store.open(ref))
    assert [(row.author, row.step == 5) for row in rows] == [("human", True), ("proposed", False)]
    people = summary(loop, ref)["people"]
    assert (people["demonstrations"], people["disputed"]) == (2, 1)
    assert (people["judged"], people["keys"], people["seconds"]) == (3, 2.0, 3.0)
    path.write_text(path.read_text() + "nonsense\n")
    with pytest.raises(InvalidLabels, match="line 5: it is not JSON"):
        annotate(loop.session, episodes=loop.demonstrations, labels=path, config=AnnotationConfig())


def test_a_run_uses_what_people_had_said_when_it_began(loop, tmp_path):
    first = EpisodeReader(loop.store.open(loop.demonstrations)).read(0)
    path = versions_path(tmp_path, "one_leg")
    said = {"episode": first.record.episode_id, "critical_state": 0, "author": "Ada"}
    save(path, [Entry(**said, step=first.recorded_step(5), after=0)])
    session, config = replace(loop.session, held={}), LoopConfig(labels=path)
    before = annotations_of(session, config, loop.demonstrations)
    save(path, [Entry(**said, step=first.recorded_step(9), after=1)])
    assert annotations_of(session, config, loop.demonstrations) == before
    after = annotations_of(replace(session, held={}), config, loop.demonstrations)
    assert [read_annotations(loop.store.open(ref))[0].step for ref in (before, after)] == [5, 9]
    missing = LoopConfig(labels=tmp_path / "missing.versions.jsonl")
    with pytest.raises(InvalidLabels, match="No such file"):
        annotations_of(session, missing, loop.demonstrations)


def test_snippets_know_their_demonstration(loop):
    records = EpisodeReader(loop.store.open(loop.corrective)).records
    assert len(records) == summary(loop, loop.corrective)["snippets"] == 2
    assert {record.parent for record in records} <= set(EpisodeReader(loop.store.open(loop.demonstrations)).ids)
    assert loop.store.lineage(loop.corrective) == [loop.demonstrations, loop.annotations]


def test_data_without_simulator_states_is_refused_where_states_are_restored(loop):
    schema = Schema(tuple(spec for spec in SIMULATOR if spec.role is not Role.STATE))
    foreign = [
        replace(
            episode,
            steps={name: episode.steps[name] for name in schema.names()},
            final={name: episode.final[name] for name in schema.ends},
            schema=schema,
        )
        for episode in read_all(loop.store, loop.demonstrations)
    ]
    recipe = replace(loop.store.manifest(loop.demonstrations).recipe, config={"of": "another project"})
    with loop.store.create(recipe) as draft:
        write_episodes(draft.path, foreign, {})
    with pytest.raises(StateMissing, match="holds no simulator state"):
        annotate(loop.session, episodes=recipe.ref, config=AnnotationConfig())
    with pytest.raises(StateMissing, match="holds no simulator state"):
        augment(loop.session, episodes=recipe.ref, annotations=loop.annotations, config=AUGMENT)
    assert learn(loop.session, recipe.ref).kind == "checkpoint"


def test_checkpoint_brings_its_curves_and_the_size_of_its_data(loop):
    facts = summary(loop, loop.checkpoint)
    assert facts["episodes"] == {"teleop": 2, "augmentation": 2}
    assert set(facts["timesteps"]) == {"teleop", "augmentation"}
    assert (facts["device"], facts["precision"]) == ("cpu", "fp32")
    curves = read_curves(loop.store.open(loop.checkpoint))
    assert curves["train/loss"][0] == (2, 4, 6)
    assert curves["validation/loss"][0] == (3, 6)


def changed(episode, **facts):
    """Another episode, whose id is its own."""
    return replace(episode, record=replace(episode.record, **facts, episode_id=""))


def test_training_on_a_selection_reads_only_the_kept_episodes(loop, tmp_path, insertions):
    rollouts = loop.store.manifest(loop.rollouts).recipe
    failed = changed(insertions[1], outcome="timeout", source="rollout")
    first, second = (changed(insertions[0], source="rollout", seed=seed) for seed in (7, 8))
    recipe = replace(rollouts, config={"made": "by hand"})
    with loop.store.create(recipe) as draft:
        write_episodes(draft.path, [failed, first, second], {})
    selection = select(loop.session, episodes=recipe.ref, config=SelectConfig(max_episodes=1))
    rows = read_selection(loop.store.open(selection))
    assert [(row.keep, row.reason) for row in rows] == [
        (False, "timeout"),
        (True, "success"),
        (False, "enough successes before it"),
    ]
    retrained = learn(loop.session, loop.demonstrations, recipe.ref, selections=(selection,))
    assert summary(loop, retrained)["episodes"] == {"teleop": 2, "rollout": 1}
    assert {recipe.ref, selection} <= set(loop.store.lineage(retrained))


def test_a_success_that_dawdled_is_not_imitated(loop, insertions):
    recipe = replace(loop.store.manifest(loop.rollouts).recipe, config={"made": "of quick and slow ones"})
    quick, another = (changed(insertions[0], source="rollout", seed=seed) for seed in (7, 8))
    failed = changed(quick, outcome="timeout", seed=9)
    twice = {name: np.concatenate([rows, rows]) for name, rows in quick.steps.items()}
    slow = changed(replace(quick, steps=twice), seed=10)
    with loop.store.create(recipe) as draft:
        write_episodes(draft.path, [slow, quick, failed, another], {})
    selection = select(loop.session, episodes=recipe.ref, config=SelectConfig(longest=1.5))
    rows = read_selection(loop.store.open(selection))
    assert [row.keep for row in rows] == [False, True, False, True]
    assert rows[0].reason == f"dawdled, it took more than {1.5 * len(quick):.0f} steps"
    everything = select(loop.session, episodes=recipe.ref, config=SelectConfig(longest=None))
    assert summary(loop, everything)["kept"] == 3


def test_rollouts_are_kept_whatever_their_outcome(loop):
    facts = summary(loop, loop.rollouts)
    assert facts["episodes"] == 2
    assert facts["outcomes"] == {"timeout": 2}
    assert EpisodeReader(loop.store.open(loop.rollouts)).records[0].policy == loop.checkpoint.id


def test_that_no_rollout_succeeded_is_an_artifact_with_a_reason(loop):
    selection = select(loop.session, episodes=loop.rollouts, config=SelectConfig())
    facts = summary(loop, selection)
    assert facts["kept"] == 0
    assert facts["finding"].startswith("no successful rollout to retrain on: none of 2")
    assert [row.reason for row in read_selection(loop.store.open(selection))] == ["timeout", "timeout"]
    with pytest.raises(NothingLeft, match="holds nothing to learn from"):
        learn(loop.session, loop.demonstrations, loop.rollouts, selections=(selection,))


def test_an_operator_who_always_fails_is_not_asked_again(loop, monkeypatch):
    monkeypatch.setattr("stages.record.record_demonstrations", write_a_failure)
    logs = record(loop.session, config=RecordConfig(**SCENE, demonstrations=1, max_recordings=1, seed=1))
    assert summary(loop, logs)["finding"] == "the scripted operator failed in all of 1 recordings"
    assert summary(loop, logs)["operator_minutes"] == 1.0
    monkeypatch.undo()
    assert record(loop.session, config=RecordConfig(**SCENE, demonstrations=1, max_recordings=1, seed=1)) == logs
    with pytest.raises(NothingLeft, match="no demonstration is left of 1 operator logs"):
        ingest(loop.session, logs=logs, config=INGEST)


def write_a_failure(folder, *arguments, **settings):
    (folder / "00000000.npz").write_bytes(b"a failure")
    return Sitting(recordings=1, steps=600)


@pytest.fixture(scope="module")
def corrections(loop):
    """What the operator makes of rollouts that got nowhere."""
    config = CorrectConfig(corrections=1, patience_steps=4, lead_steps=2)
    return correct(loop.session, episodes=loop.rollouts, config=config)


def test_an_operator_finishes_a_rollout_that_got_nowhere(loop, corrections):
    (episode,) = EpisodeReader(loop.store.open(corrections)).records
    assert (episode.source, episode.outcome) == ("correction", Outcome.SUCCESS)
    assert episode.parent in EpisodeReader(loop.store.open(loop.rollouts)).ids
    facts = summary(loop, corrections)
    assert facts["share"] == 1 / facts["attempts"]
    assert facts["human_steps"] >= facts["steps"] > 0
    assert facts["by_milestone"]["start"]["corrections"] == 1


def test_an_operator_with_a_human_hand_corrects_like_one(loop, corrections):
    config = CorrectConfig(corrections=1, patience_steps=4, lead_steps=2, temperament=Human())
    human = correct(loop.session, episodes=loop.rollouts, config=config)
    (steady,) = read_all(loop.store, corrections)
    assert all(
        not np.array_equal(steady.steps["action"][0], each.steps["action"][0]) for each in read_all(loop.store, human)
    )
    assert summary(loop, human)["human_steps"] != summary(loop, corrections)["human_steps"]


def test_a_policy_learns_from_corrections_and_the_report_counts_the_human_minutes(loop, corrections):
    checkpoint = learn(loop.session, loop.demonstrations, loop.corrective, corrections)
    assert summary(loop, checkpoint)["episodes"] == {"teleop": 2, "augmentation": 2, "correction": 1}
    evaluation = evaluate(loop.session, checkpoint=checkpoint, config=EVALUATE)
    rows = (ReportRow(condition="dagger", title="DAgger", seed=0),)
    study = task_study(loop.store, "one_leg", [evaluation], rows)
    effort, rounds = sections([study], (effort_section, rounds_section))
    of_demonstrations, by_condition = effort.tables
    told = dict(zip(by_condition.columns, by_condition.rows[0], strict=True))
    minutes = {
        "demonstrations": summary(loop, loop.demonstrations)["operator_minutes"],
        "labels": 2 * 12 / 60,
        "corrections": round(summary(loop, corrections)["human_steps"] / 600, 2),
    }
    for name, spent in minutes.items():
        assert told[f"{name}, min"] == f"{spent:.1f}"
    assert told["together, min"] == f"{sum(minutes.values()):.1f}"
    assert told["points a minute"] == "0.0"
    assert of_demonstrations.rows[0][of_demonstrations.columns.index("minutes")] == told["demonstrations, min"]
    (row,) = rounds.tables[0].rows
    assert row[0] == "DAgger"
    assert row[1].startswith("0% (0% to ")
    assert row[2] == "0%"


def test_where_no_rollout_failed_nothing_is_corrected(loop):
    ref = correct(loop.session, episodes=loop.demonstrations, config=CorrectConfig())
    assert len(EpisodeReader(loop.store.open(ref))) == 0
    assert loop.store.manifest(ref).finding == f"no correction: no rollout in {loop.demonstrations} failed"


def test_attempts_that_gave_no_snippet_are_not_made_again(loop):
    impossible = AUGMENT.model_copy(
        update={"max_attempts_per_snippet": 1, "tolerance": ToleranceConfig(position_m=1e-9)}
    )
    inputs = {"episodes": loop.demonstrations, "annotations": loop.annotations, "config": impossible}
    corrective = augment(loop.session, **inputs)
    facts = summary(loop, corrective)
    assert (facts["snippets"], facts["attempts"]) == (0, 2)
    assert "none of 2 attempts succeeded" in facts["finding"]
    reader = EpisodeReader(loop.store.open(corrective))
    assert (len(reader), reader.records) == (0, [])
    before = loop.store.refs()
    assert augment(loop.session, **inputs) == corrective
    assert loop.store.refs() == before
    with pytest.raises(NothingLeft, match="holds nothing to learn from"):
        learn(loop.session, loop.demonstrations, corrective)


def test_a_checkpoint_tells_how_much_of_its_data_windows_reach(loop):
    facts = summary(loop, loop.checkpoint)
    assert sum(facts["windows"].values()) == facts["num_windows"]
    for source, timesteps in facts["timesteps"].items():
        used = facts["windows"][source] + facts["validation_windows"][source]
        assert used + facts["unused_timesteps"][source] == timesteps


def test_a_training_that_most_snippets_are_too_short_for_names_the_settings_to_change(loop):
    lengths = [len(episode) for episode in read_all(loop.store, loop.corrective)]
    horizons = HorizonConfig(pred=max(lengths), action=4)
    windows = WindowConfig(back_padding=0)
    config = TRAIN.model_copy(
        update={
            "policy": TRAIN.policy.model_copy(update={"horizons": horizons}),
            "training": TRAINING.model_copy(update={"windows": windows}),
        }
    )
    refusal = (
        rf"of {sum(lengths)} augmentation steps only \d+ begin a window, .*"
        r"policy\.horizons\.pred.*training\.windows\.back_padding.*augment\.steps_after_gripper_change"
    )
    with pytest.raises(TrainingFailed, match=refusal):
        learn(loop.session, loop.demonstrations, loop.corrective, config=config)


def read_all(store, ref):
    reader = EpisodeReader(store.open(ref))
    return [reader.read(index) for index in range(len(reader))]


def test_evaluation_has_a_row_an_episode_an_interval_and_examples(loop):
    folder = loop.store.open(loop.evaluation)
    rows = read_evaluation(folder)
    facts = summary(loop, loop.evaluation)
    assert len({row.seed for row in rows}) == facts["episodes"] == 3
    assert facts["interval_low"] <= facts["success_rate"] <= facts["interval_high"]
    assert len(EpisodeReader(folder / "examples")) == 3


def test_evaluation_does_not_depend_on_how_many_episodes_run_beside_each_other(loop):
    other = evaluate(replace(loop.session, machine=Machine(num_envs=1)), checkpoint=loop.checkpoint, config=EVALUATE)
    assert other == loop.evaluation
    store = ArtifactStore(loop.store.url + "-other")
    for ref in (loop.demonstrations, loop.annotations, loop.corrective, loop.checkpoint):
        with store.create(loop.store.manifest(ref).recipe) as draft:
            for path in loop.store.open(ref).rglob("*"):
                if path.is_file() and path.name != "manifest.json":
                    target = draft.path / path.relative_to(loop.store.open(ref))
                    target.parent.mkdir(parents=True, exist_ok=True)
                    target.write_bytes(path.read_bytes())
    again = evaluate(
        replace(loop.session, store=store, machine=Machine(num_envs=1)), checkpoint=loop.checkpoint, config=EVALUATE
    )
    assert store.manifest(again).content == loop.store.manifest(loop.evaluation).content


class QuickSuccesses(AssemblyEnv):
    """Succeeds in three steps from states of odd seeds, and lasts from the others."""

    def reset(self, *, seed=None, options=None):
        self.seed, self.taken = seed, 0
        return super().reset(seed=seed)

    def step(self, action):
        observation, reward, terminated, truncated, info = super().step(action)
        self.taken += 1
        if self.seed % 2 and self.taken == 3:
            info["outcome"], terminated = Outcome.SUCCESS, True
        return observation, reward, terminated, truncated, info


@pytest.mark.parametrize("num_envs", [1, 3, 8])
def test_an_evaluation_that_stops_does_not_prefer_quick_successes_to_slow_failures(loop, monkeypatch, num_envs):
    monkeypatch.setattr("juicer.rollout.AssemblyEnv", QuickSuccesses)
    forced = frozenset({"evaluate"})
    session = replace(loop.session, machine=Machine(num_envs=num_envs), forced=forced, fresh=set())
    config, stop = EVALUATE.model_copy(update={"episodes": 12}), StopConfig(every=4, width=0.8, comparison=False)
    ref = measure_alone(session, loop.checkpoint, config, stop)
    rows, facts = read_evaluation(loop.store.open(ref)), summary(loop, ref)
    assert [row.seed for row in rows] == list(range(3_000_000, 3_000_008))
    assert [row.outcome is Outcome.SUCCESS for row in rows] == [False, True] * 4
    assert (facts["interval_low"], facts["interval_high"]) == anytime_interval(4, 8)


def test_an_evaluation_in_blocks_is_the_one_at_once(loop):
    config = EVALUATE.model_copy(update={"episodes": 5, "anytime": True})
    first = evaluate(loop.session, checkpoint=loop.checkpoint, config=config.model_copy(update={"episodes": 2}))
    whole = evaluate(loop.session, checkpoint=loop.checkpoint, config=config)
    blocks = evaluate(loop.session, checkpoint=loop.checkpoint, previous=first, config=config)
    assert blocks != whole
    assert loop.store.manifest(blocks).content == loop.store.manifest(whole).content
    assert summary(loop, blocks) == (facts := summary(loop, whole))
    assert (facts["interval_low"], facts["interval_high"]) == anytime_interval(facts["successes"], 5)
    row = evaluated_row(loop.store, blocks, 4)
    assert not recomputed_episode(loop.store, blocks, row).differences


@pytest.mark.parametrize("changes", [{"episodes": 2}, {"first": 1}, {"seed": 1}, {"anytime": True}])
def test_an_evaluation_continues_none_but_its_own_beginning(loop, changes):
    config = EVALUATE.model_copy(update={"episodes": 5, **changes})
    with pytest.raises(ConfigError, match="is not the beginning of"):
        evaluate(loop.session, checkpoint=loop.checkpoint, previous=loop.evaluation, config=config)


def test_other_sampling_steps_make_another_evaluation_and_a_head_without_them_refuses_them(loop):
    config = EVALUATE.model_copy(update={"inference_steps": 2})
    assert evaluate.prepare(loop.store, checkpoint=loop.checkpoint, config=config).recipe.ref != loop.evaluation
    with pytest.raises(ConfigError, match="a head of kind 'mlp' has no inference_steps"):
        evaluate(loop.session, checkpoint=loop.checkpoint, config=config)


def test_inputs_of_the_wrong_kind_are_refused(loop):
    with pytest.raises(WrongArtifactKind, match="stage 'train' needs 'dataset'"):
        train(loop.session, dataset=loop.demonstrations, config=TRAIN)
    with pytest.raises(WrongArtifactKind, match="stage 'dataset' needs 'episodes'"):
        dataset(loop.session, episodes=(loop.checkpoint,), config=DatasetConfig())
    with pytest.raises(WrongArtifactKind, match="stage 'evaluate' needs 'checkpoint'"):
        evaluate(loop.session, checkpoint=loop.demonstrations, config=EVALUATE)


def test_recorded_logs_become_demonstrations(loop):
    logs = record(loop.session, config=RecordConfig(**SCENE, demonstrations=1))
    facts = summary(loop, logs)
    assert facts["successes"] == 1
    demonstrations = ingest(loop.session, logs=logs, config=IngestionConfig(task="one_leg"))
    (episode,) = EpisodeReader(loop.store.open(demonstrations)).records
    assert episode.device == facts["device"]


def test_report_tells_of_every_condition_and_finding(loop):
    config = ReportConfig(
        title="A study", rows=(ReportRow(condition="ta", title="TA", seed=0),), findings=("CI, seed 0: no success.",)
    )
    ref = report(loop.session, evaluations=(loop.evaluation,), config=config)
    page = (loop.store.open(ref) / "report.html").read_text()
    assert "A study" in page
    assert "CI, seed 0: no success." in page
    assert loop.evaluation.id[:6] in page
    assert json.dumps(summary(loop, ref)["best_condition"]) == '"ta"'


def write_report(loop, evaluation=None, **facts):
    config = ReportConfig(title="A study", rows=(ReportRow(condition="ta", title="TA", seed=0),), **facts)
    return report(loop.session, evaluations=(evaluation or loop.evaluation,), config=config)


def test_report_shows_a_video_of_an_episode_and_lists_all(loop, drawing):
    ref = write_report(loop, configuration={"flow": "study", "name": "A study"})
    folder = loop.store.open(ref)
    page = (folder / "report.html").read_text()
    assert summary(loop, ref)["videos"] == ["failure.mp4"]
    with av.open(str(folder / "failure.mp4")) as video:
        frames = [*video.decode(video=0)]
    assert len(frames) == 1 + EVALUATE.max_steps // 2
    assert base64.b64encode((folder / "failure.mp4").read_bytes()).decode() in page
    assert "A typical failure" in page
    for row in read_evaluation(loop.store.open(loop.evaluation)):
        assert f"{row.episode}\t{row.seed}\t{row.outcome.value}\t" in page
    assert "juicer run A-study.yaml" in page
    assert read_mapping(folder / "configuration.yaml") == {"flow": "study", "name": "A study"}


def test_report_is_written_where_nothing_can_be_drawn(loop, monkeypatch):
    def refuse(*_):
        raise RenderingUnavailable("no OpenGL platform can draw an image here")

    monkeypatch.setattr("juicer.imaging.renderer.ViewRenderer.draw_for_people", refuse)
    ref = write_report(loop, findings=("drawn nowhere",))
    page = (loop.store.open(ref) / "report.html").read_text()
    assert "No videos or images of episodes: no OpenGL platform can draw an image here." in page
    assert "<video" not in page
    assert summary(loop, ref)["videos"] == []
    assert not list(loop.store.open(ref).glob("*.mp4"))


def test_addresses_of_pages_are_shown_but_are_no_part_of_a_report_s_identity(loop):
    links = {"MLflow": "https://mlflow.example.org/#/experiments"}
    with_links = ReportConfig(title="Addresses", rows=(ReportRow(condition="ta", title="TA", seed=0),), links=links)
    without = with_links.model_copy(update={"links": {}})
    found = report.prepare(loop.session, evaluations=(loop.evaluation,), config=with_links).recipe
    assert found.id == report.prepare(loop.session, evaluations=(loop.evaluation,), config=without).recipe.id
    ref = report(loop.session, evaluations=(loop.evaluation,), config=with_links)
    assert links["MLflow"] in (loop.store.open(ref) / "report.html").read_text()


def test_report_does_without_what_is_lost_and_says_so(loop, tmp_path):
    store = ArtifactStore(tmp_path / "store")
    shutil.copytree(loop.store.url, tmp_path / "store")
    damaged = store.open(loop.checkpoint) / "curves.json"
    store.set_aside(loop.demonstrations)
    damaged.write_text("[]")
    lossy = replace(loop, session=replace(loop.session, store=store))
    page = (store.open(write_report(lossy)) / "report.html").read_text()
    assert f"{loop.demonstrations} is no longer there or damaged; what it tells is missing here" in page
    assert f"No curves of {loop.checkpoint}" in page
    (store.open(loop.annotations) / "manifest.json").write_text("nonsense")
    store.set_aside(loop.checkpoint)
    page = (store.open(write_report(lossy, findings=("once more",))) / "report.html").read_text()
    assert f"{loop.checkpoint} is no longer there or damaged" in page


def test_a_report_on_nothing_is_refused_in_a_sentence(loop):
    with pytest.raises(NothingLeft, match="no evaluation to report on"):
        report(loop.session, evaluations=(), config=ReportConfig(title="Nothing"))
    with pytest.raises(ConfigError, match="a report on 1 evaluations needs as many rows that name them, got 0"):
        report(loop.session, evaluations=(loop.evaluation,), config=ReportConfig(title="Nothing"))
    recipe = replace(loop.store.manifest(loop.evaluation).recipe, config={"made": "empty"})
    with loop.store.create(recipe) as draft:
        write_evaluation(draft.path, [])
    with pytest.raises(ArtifactError, match="holds no episode, so it says nothing about TA, seed 0"):
        write_report(loop, evaluation=recipe.ref)


def test_an_episode_that_was_not_kept_is_computed_again_as_it_was(loop):
    ref = evaluate(loop.session, checkpoint=loop.checkpoint, config=EVALUATE.model_copy(update={"episodes": 5}))
    rows = read_evaluation(loop.store.open(ref))
    assert [kept_episode(loop.store, ref, row) is not None for row in rows] == [True] * 3 + [False] * 2
    for row in rows:
        found = recomputed_episode(loop.store, ref, row)
        assert found.differences == ()
        assert (found.episode.record.outcome, len(found.episode)) == (row.outcome, row.length)
    kept, again = kept_episode(loop.store, ref, rows[1]), recomputed_episode(loop.store, ref, rows[1])
    for name, values in kept.episode.steps.items():
        np.testing.assert_array_equal(again.episode.steps[name], values)
    assert again.episode.record == kept.episode.record
    with pytest.raises(ConfigError, match="has episodes 0 to 4, not 5"):
        evaluated_row(loop.store, ref, 5)
    with pytest.raises(ConfigError, match="has episodes 0 to 4, not -1"):
        evaluated_row(loop.store, ref, -1)


def test_an_episode_that_comes_out_otherwise_is_not_passed_off_as_the_evaluated_one(loop):
    row = evaluated_row(loop.store, loop.evaluation, 0)
    claimed = replace(row, outcome=Outcome.SUCCESS, length=7, parts_assembled=1, milestones={"top_placed": 3})
    found = recomputed_episode(loop.store, loop.evaluation, claimed)
    assert found.differences == (
        "it ends as timeout, not as success",
        "it takes 12 steps, not 7",
        "0 parts are assembled, not 1",
        "it reaches no milestone, not top_placed at step 3",
        "code and libraries are the same, so the processor or its mathematical libraries differ",
    )


def test_an_episode_whose_policy_is_gone_is_told_in_a_sentence(loop, tmp_path):
    shutil.copytree(loop.store.url, tmp_path / "store")
    store = ArtifactStore(tmp_path / "store")
    store.set_aside(loop.checkpoint)
    with pytest.raises(ArtifactError, match=f"artifact {loop.checkpoint} does not exist"):
        recomputed_episode(store, loop.evaluation, evaluated_row(store, loop.evaluation, 0))


def test_report_on_a_model_for_several_tasks_tells_their_data_apart(loop):
    store = loop.store

    def copied(ref, **changes):
        """The same artifact, as if it had been made of other things."""
        original = store.manifest(ref)
        recipe = replace(original.recipe, **changes)
        with store.create(recipe) as draft:
            shutil.copytree(
                store.open(ref), draft.path, dirs_exist_ok=True, ignore=shutil.ignore_patterns("manifest.json")
            )
            draft.summary |= original.summary
        return recipe.ref

    of_lamp = copied(loop.demonstrations, config=store.manifest(loop.demonstrations).recipe.config | {"task": "lamp"})
    inputs = {"episodes": (of_lamp,), "annotations": (loop.annotations,)}
    corrective = copied(loop.corrective, inputs=inputs)
    data = (loop.demonstrations, loop.corrective, of_lamp, corrective)
    checkpoint = copied(loop.checkpoint, inputs={"episodes": data})
    evaluation = copied(loop.evaluation, inputs={"checkpoint": (checkpoint,)})
    rows = [ReportRow(condition="multitask", title="Multi-task", seed=0)]
    told = gather(Sources(store, [evaluation], rows), [], title="", task="one_leg", facts={}, findings=())
    steps = summary(loop, loop.demonstrations)["steps"]
    assert told.facts["Demonstrations"] == f"one_leg 2 ({steps} steps), lamp 2 ({steps} steps)"
    assert [each.label for each in told.augmentations] == [
        "2 corrective episodes of one_leg",
        "2 corrective episodes of lamp",
    ]
    store.set_aside(of_lamp)
    told = gather(Sources(store, [evaluation], rows), [], title="", task="one_leg", facts={}, findings=())
    assert told.facts["Demonstrations"] == f"2 ({steps} steps)"
    assert told.augmentations[1].label == "2 corrective episodes of demonstrations that are no longer there"


def test_replayed_demonstrations_succeed_from_the_state_they_began_in(loop):
    checkpoint = memorise(loop.session, episodes=loop.demonstrations, config=MemoriseConfig())
    policy = load_policy(loop.store.open(checkpoint), "one_leg")
    (demonstration, *_) = EpisodeReader(loop.store.open(loop.demonstrations)).records
    (episode,) = rollout(policy, "one_leg", "low", [demonstration.seed], num_envs=1)
    recorded = EpisodeReader(loop.store.open(loop.demonstrations)).read(0)
    assert episode.record.outcome == "success"
    np.testing.assert_array_equal(episode.steps["action"], recorded.steps["action"][: len(episode)])
    assert evaluate(loop.session, checkpoint=checkpoint, config=EVALUATE).kind == "evaluation"


def test_a_replay_answers_observations_of_one_step_and_says_what_it_lacks(loop):
    checkpoint = memorise(loop.session, episodes=loop.demonstrations, config=MemoriseConfig())
    policy = load_policy(loop.store.open(checkpoint), "one_leg")
    poses = EpisodeReader(loop.store.open(loop.demonstrations)).read(0).steps["part_poses"][:1]
    np.testing.assert_array_equal(
        policy.predict({"part_poses": poses}, []), policy.predict({"part_poses": poses[:, None]}, [])
    )
    with pytest.raises(InvalidObservation, match="observations lack 'part_poses'"):
        policy.predict({"proprioception": poses}, [])


def test_an_artifact_without_episodes_is_refused_in_a_sentence(loop):
    with loop.store.create(Recipe("correct", "episodes")) as draft:
        write_episodes(draft.path, [], {}, may_be_empty=True)
    for stage, config in ((select, SelectConfig()), (memorise, MemoriseConfig())):
        with pytest.raises(NothingLeft, match="holds no episode"):
            stage(loop.session, episodes=draft.ref, config=config)


def test_demonstrations_are_not_replayed_on_another_task(loop):
    checkpoint = memorise(loop.session, episodes=loop.demonstrations, config=MemoriseConfig())
    with pytest.raises(InvalidCheckpoint, match="show 'one_leg', not 'square_table'"):
        evaluate(
            loop.session,
            checkpoint=checkpoint,
            config=EvaluateConfig(task="square_table", randomness="low", episodes=1),
        )


def test_a_replay_lasts_as_long_as_the_episodes_may(loop, monkeypatch):
    checkpoint = memorise(loop.session, episodes=loop.demonstrations, config=MemoriseConfig())
    horizons = []

    def note_horizon(policy, *_, **__):
        horizons.append(policy.action_horizon)
        return iter(())

    monkeypatch.setattr("juicer.policy_rollout.rollout", note_horizon)
    with pytest.raises(NothingLeft):
        evaluate(loop.session, checkpoint=checkpoint, config=EvaluateConfig(**SCENE, max_steps=7000))
    assert horizons == [7000]


@pytest.mark.parametrize("kind", ["outside", "push", "friction"])
def test_an_evaluation_under_a_shift_says_so_and_can_be_made_again(loop, kind):
    shift = {"kind": kind} | ({"earliest": 0.002, "latest": 0.004} if kind == "push" else {})
    config = EvaluateConfig(**SCENE, episodes=2, max_steps=12, shift=shift)
    ref = evaluate(loop.session, checkpoint=loop.checkpoint, config=config)
    facts = summary(loop, ref)
    assert facts["shift"] == config.shift.phrase
    assert all(config.shift.phrase in facts[name] for name in ("headline", "label"))
    usual, rows = (read_evaluation(loop.store.open(each)) for each in (loop.evaluation, ref))
    assert [row.seed for row in rows] == [row.seed for row in usual[:2]]
    kept, again = kept_episode(loop.store, ref, rows[1]), recomputed_episode(loop.store, ref, rows[1])
    assert again.differences == ()
    np.testing.assert_array_equal(kept.episode.steps["sim_state"], again.episode.steps["sim_state"])
    unshifted = kept_episode(loop.store, loop.evaluation, usual[1]).episode
    seen = {name: kept.episode.steps[name] for name in unshifted.schema.names(Role.OBSERVATION)}
    differs = any(not np.array_equal(values, unshifted.steps[name]) for name, values in seen.items())
    # Nothing slides in so few steps.
    assert differs == (kind != "friction")
    assert parse_shift(kept.episode.record.shift) == config.shift


def test_a_policy_that_sees_no_images_is_not_measured_under_another_light(loop):
    config = EvaluateConfig(**SCENE, episodes=2, max_steps=12, shift={"kind": "light"})
    with pytest.raises(ConfigError, match="the policy sees no images, so it cannot notice a shift of kind 'light'"):
        evaluate(loop.session, checkpoint=loop.checkpoint, config=config)


def test_nothing_is_learned_from_what_was_made_under_a_shift(loop):
    config = EvaluateConfig(**SCENE, episodes=2, max_steps=12, shift={"kind": "friction"})
    examples = loop.store.open(evaluate(loop.session, checkpoint=loop.checkpoint, config=config)) / "examples"
    reader = EpisodeReader(examples)
    with loop.store.create(Recipe("by hand", "episodes")) as draft:
        write_episodes(draft.path, [reader.read(0)], {})
    for learn_from in (
        lambda: select(loop.session, episodes=draft.ref, config=SelectConfig()),
        lambda: dataset(loop.session, episodes=(loop.demonstrations, draft.ref), config=DatasetConfig()),
        lambda: memorise(loop.session, episodes=draft.ref, config=MemoriseConfig()),
    ):
        with pytest.raises(
            EvaluationOnly, match=f"{draft.ref} holds episode .* made under a shift .*friction.*leave it"
        ):
            learn_from()


def test_a_report_shows_a_column_for_each_shift_and_counts_its_cost(loop):
    config = EvaluateConfig(**SCENE, episodes=3, max_steps=12, shift={"kind": "friction"})
    shifted = evaluate(loop.session, checkpoint=loop.checkpoint, config=config)
    row = ReportRow(condition="bc", title="BC", seed=0, unnoticed=("light",))
    rows = (row, row.model_copy(update={"shift": "slippery"}))
    study = task_study(loop.store, "one_leg", (loop.evaluation, shifted), rows)
    data = gather(
        study.sources,
        [each.result for each in study.measured.values()],
        title="t",
        task="one_leg",
        sections=sections([study]),
        facts={},
        findings=(),
    )
    (result,) = data.results
    assert result.num_episodes == 3
    assert result.shifted["slippery"].num_episodes == 3
    assert result.shifted["light"] is None
    (by_stage,) = (table for section in data.sections for table in section.tables if table.columns[0] == "stage")
    assert {row[0]: row[1] for row in by_stage.rows}["evaluate"] == "2"
    assert len(data.models) == 1
    page = render_page(data)
    assert "<th>slippery</th><th>light</th>" in page
    assert "sees no images" in page
