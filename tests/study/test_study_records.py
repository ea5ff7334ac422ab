"""What a study's page is written from fits into an archive, and stores that never met come together in it."""

from __future__ import annotations

import tarfile

import pytest

from benchmarks.study_records import pack
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Outcome
from juicer.errors import DamagedArtifact
from juicer.storage.evaluations import EXAMPLES, EvaluationRow, read_evaluation, write_evaluation


def evaluated(store: ArtifactStore, seed: int, success: Outcome):
    """An evaluation with its checkpoint; their references."""
    trained = Recipe("train", "checkpoint", {}, {"seed": seed})
    with store.create(trained) as draft:
        (draft.path / "weights").write_bytes(bytes(1000))
    recipe = Recipe("evaluate", "evaluation", {"checkpoint": (trained.ref,)}, {"seed": seed})
    with store.create(recipe) as draft:
        write_evaluation(draft.path, [EvaluationRow(0, 3_000_000, success, 1, 423)])
        (draft.path / EXAMPLES).mkdir()
        (draft.path / EXAMPLES / "episode").write_bytes(bytes(1000))
        draft.summary |= {"success_rate": 1.0}
    return trained.ref, recipe.ref


@pytest.fixture
def packed(tmp_path):
    """Two stores, and what an archive of both unpacks to."""
    stores = [ArtifactStore(tmp_path / name) for name in ("one", "other")]
    made = [evaluated(stores[0], 0, Outcome.SUCCESS), evaluated(stores[1], 1, Outcome.SUCCESS)]
    evaluated(stores[1], 0, Outcome.TIMEOUT)
    assert pack(tmp_path / "records.tar.xz", stores) == 4
    with tarfile.open(tmp_path / "records.tar.xz") as tar:
        tar.extractall(tmp_path / "unpacked", filter="data")
    return stores, ArtifactStore(tmp_path / "unpacked"), made


def test_evaluations_of_all_stores_are_in_it_without_their_examples(packed):
    _, unpacked, made = packed
    for _, evaluation in made:
        assert not unpacked.verify(evaluation)
        assert [row.outcome for row in read_evaluation(unpacked.open(evaluation, "evaluation"))] == [Outcome.SUCCESS]
        assert not (unpacked.open(evaluation) / EXAMPLES).exists()


def test_of_everything_else_it_holds_what_was_written_down(packed):
    stores, unpacked, made = packed
    checkpoint, evaluation = made[0]
    assert unpacked.manifest(checkpoint) == stores[0].manifest(checkpoint)
    assert unpacked.lineage(evaluation) == stores[0].lineage(evaluation)
    with pytest.raises(DamagedArtifact, match="weights"):
        unpacked.open(checkpoint)


def test_an_archive_that_is_there_survives_a_store_that_cannot_be_read(tmp_path):
    store = ArtifactStore(tmp_path / "store")
    _, evaluation = evaluated(store, 0, Outcome.SUCCESS)
    archive = tmp_path / "records.tar.xz"
    pack(archive, [store])
    before = archive.read_bytes()
    (store.open(evaluation) / "evaluation.parquet").unlink()
    with pytest.raises(DamagedArtifact, match="evaluation"):
        pack(archive, [store])
    assert archive.read_bytes() == before
