"""A label means one step of one recording, whatever else is ingested with it, and however."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from juicer.annotation.annotate import annotate
from juicer.annotation.labels import read_labels
from juicer.annotation.propose import AnnotationConfig
from juicer.annotation.rewriting import labels_of, read_numbered_labels, write_labels
from juicer.demonstration.ingestion import Demonstration, IngestionConfig, ingest
from juicer.demonstration.log import OperatorLog, write_log
from juicer.episode import Episode
from juicer.errors import InvalidLabels
from juicer.storage.tables import Annotation

STEP = 142


class Ingested:
    """What a folder of logs becomes."""

    def __init__(self, folder: Path, kept_after_toggle: int = 12) -> None:
        config = IngestionConfig(task="one_leg", kept_after_toggle=kept_after_toggle)
        results = ingest(sorted(folder.glob("*.npz")), config)
        self.episodes: list[Episode] = [each.episode for each in results if isinstance(each, Demonstration)]
        self.records = [episode.record for episode in self.episodes]

    def __len__(self) -> int:
        return len(self.episodes)

    def read(self, index: int) -> Episode:
        return self.episodes[index]


@pytest.fixture
def folder(tmp_path: Path, recording: OperatorLog) -> Path:
    """One log, whose operator was idle before and after the labelled step."""
    write_log(tmp_path / "demo_2.npz", hesitant(recording))
    return tmp_path


def hesitant(log: OperatorLog) -> OperatorLog:
    idle = np.array(log.idle)
    idle[[0, 1, 2, 15, 16, STEP + 1]] = True
    return replace(log, idle=idle)


def meaning(demonstrations: Ingested, labels: Path) -> Annotation:
    (row,) = (row for row in annotate(demonstrations, AnnotationConfig(), read_labels(labels)) if row.author == "human")
    return row


def label(folder: Path, recording: str, step: int = STEP) -> Path:
    path = folder / "labels.csv"
    path.write_text(f"recording,step,critical_state\n{recording},{step},0\n")
    return path


def test_the_step_of_a_label_is_that_of_the_recording_although_idle_steps_before_it_are_dropped(
    folder: Path, recording: OperatorLog
):
    demonstrations = Ingested(folder)
    row = meaning(demonstrations, label(folder, "demo_2.npz"))
    assert row.step < STEP
    np.testing.assert_array_equal(demonstrations.read(0).state(row.step), recording.steps["sim_state"][STEP])


def test_a_label_in_a_dropped_stretch_means_the_last_step_before_it(folder: Path, recording: OperatorLog):
    demonstrations = Ingested(folder, kept_after_toggle=0)
    row = meaning(demonstrations, label(folder, "demo_2.npz", STEP + 1))
    np.testing.assert_array_equal(demonstrations.read(0).state(row.step), recording.steps["sim_state"][STEP])


@pytest.mark.parametrize("by_id", [False, True])
def test_other_logs_before_it_in_the_folder_change_nothing_whole_or_damaged(
    folder: Path, second_recording: OperatorLog, by_id: bool
):
    alone = Ingested(folder)
    labels = label(folder, alone.records[0].episode_id[:8] if by_id else "demo_2.npz")
    expected = meaning(alone, labels)
    write_log(folder / "demo_10.npz", second_recording)
    both = Ingested(folder)
    assert [record.log for record in both.records] == ["demo_10.npz", "demo_2.npz"]
    assert meaning(both, labels) == expected
    (folder / "demo_10.npz").write_bytes(b"damaged")
    assert meaning(Ingested(folder), labels) == expected


def test_a_label_whose_log_is_damaged_or_gone_is_an_error_that_names_it(folder: Path, second_recording: OperatorLog):
    write_log(folder / "demo_10.npz", second_recording)
    labels = label(folder, "demo_10.npz")
    assert meaning(Ingested(folder), labels).step == STEP - np.count_nonzero(second_recording.idle[:STEP])
    (folder / "demo_10.npz").write_bytes(b"damaged")
    with pytest.raises(InvalidLabels, match=r"labels\.csv, line 2: there is no demonstration of a recording 'demo_10"):
        meaning(Ingested(folder), labels)


@pytest.mark.parametrize("name", ["labels.csv", "labels.yaml"])
def test_annotations_written_as_labels_mean_the_same(folder: Path, name: str):
    demonstrations = Ingested(folder)
    proposed = list(annotate(demonstrations, AnnotationConfig()))
    write_labels(folder / name, labels_of(proposed, demonstrations))
    again = list(annotate(demonstrations, AnnotationConfig(), read_labels(folder / name)))
    assert [(row.episode_id, row.step) for row in again] == [(row.episode_id, row.step) for row in proposed]
    assert {row.author for row in again} == {"human"}
    with pytest.raises(InvalidLabels, match="exists already; name another"):
        write_labels(folder / name, [])


def test_numbers_of_an_earlier_juicer_are_rewritten_to_the_same_steps(folder: Path):
    demonstrations = Ingested(folder)
    old = folder / "old.csv"
    old.write_text("episode,step,critical_state\n0,100,0\n")
    with pytest.raises(InvalidLabels, match="it numbers episodes"):
        read_labels(old)
    write_labels(folder / "new.csv", read_numbered_labels(old, demonstrations))
    assert meaning(demonstrations, folder / "new.csv").step == 100
    for text, message in (("1,100,0", "there is no episode 1"), ("0,9999,0", "episode 0 has no step 9999")):
        old.write_text(f"episode,step,critical_state\n{text}\n")
        with pytest.raises(InvalidLabels, match=message):
            read_numbered_labels(old, demonstrations)
