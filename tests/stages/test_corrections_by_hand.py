"""Rollouts that people finished by hand are learned from, among demonstrations of the same folder."""

from __future__ import annotations

import pytest

from juicer.annotation.propose import AnnotationConfig
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore
from juicer.demonstration.ingestion import IngestionConfig
from juicer.demonstration.log import write_log
from juicer.episode import Source
from juicer.storage.annotations import read_annotations
from juicer.storage.dataset import read_dataset
from juicer.storage.episodes import EpisodeReader, write_episodes
from juicer.training.mixing import DatasetConfig
from stages.annotate import annotate
from stages.augment import AugmentConfig, augment
from stages.dataset import dataset
from stages.ingest import ingest
from stages.runtime.execution import perform_here
from stages.runtime.session import Session
from tests.pages.conftest import commit
from tests.teleoperation.rollouts import corrected_log, stuck_rollout


@pytest.fixture(scope="module")
def stuck():
    return stuck_rollout()


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    return Session(ArtifactStore(tmp_path_factory.mktemp("store")), perform_here)


@pytest.fixture(scope="module")
def demonstrations(session, tmp_path_factory, recording, stuck):
    folder = tmp_path_factory.mktemp("logs")
    write_log(folder / "demonstration.npz", recording)
    write_log(folder / "correction.npz", corrected_log(stuck, len(stuck) - 5))
    return ingest(session, files=tuple(folder.iterdir()), config=IngestionConfig(task="one_leg"))


def test_both_are_in_one_artifact_and_a_correction_says_what_it_was_grown_from(session, demonstrations, stuck):
    correction, demonstration = EpisodeReader(session.store.open(demonstrations)).records
    assert (demonstration.source, demonstration.parent) == (Source.TELEOP, None)
    assert (correction.source, correction.parent) == (Source.CORRECTION, stuck.record.episode_id)
    assert correction.parent_step == len(stuck) - 5
    facts = session.store.manifest(demonstrations).summary
    assert (facts["episodes"], facts["corrections"], facts["rejected"]) == (2, 1, 0)


def test_critical_states_of_a_correction_are_found_and_grown_from(session, demonstrations):
    annotations = annotate(session, episodes=demonstrations, config=AnnotationConfig())
    ids = [record.episode_id for record in EpisodeReader(session.store.open(demonstrations)).records]
    assert [row.episode_id for row in read_annotations(session.store.open(annotations))] == ids
    corrective = augment(
        session, episodes=demonstrations, annotations=annotations, config=AugmentConfig(num_snippets=4)
    )
    assert {record.parent for record in EpisodeReader(session.store.open(corrective)).records} == set(ids)


def test_a_dataset_takes_both_or_leaves_corrections_out(session, demonstrations):
    for sources, expected in ((None, {"correction", "teleop"}), ((Source.TELEOP,), {"teleop"})):
        ref = dataset(session, episodes=(demonstrations,), config=DatasetConfig(sources=sources))
        assert {row.source for row in read_dataset(session.store.open(ref))} == expected


def test_a_correction_is_of_the_family_of_its_rollout(session, demonstrations, stuck):
    rollouts = commit(
        session.store, Recipe("collect", "episodes"), {}, lambda folder: write_episodes(folder, [stuck], {})
    )
    ref = dataset(session, episodes=(demonstrations, rollouts), config=DatasetConfig())
    families = {row.source: row.family for row in read_dataset(session.store.open(ref))}
    assert families["correction"] == families["rollout"] != families["teleop"]
