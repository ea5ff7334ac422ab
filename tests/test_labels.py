from __future__ import annotations

from pathlib import Path

import pytest

from juicer.errors import InvalidLabels
from juicer.labels import read_labels


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_csv_and_yaml_say_the_same(tmp_path: Path):
    table = write(tmp_path, "labels.csv", "episode,step,critical_state\n3, 120, 0\n4, 77, 0\n")
    listing = write(
        tmp_path,
        "labels.yaml",
        "- {episode: 3, step: 120, critical_state: 0}\n- {episode: 4, step: 77, critical_state: 0}\n",
    )
    first, second = read_labels(table), read_labels(listing)
    assert [(label.episode, label.step, label.critical_state) for label in first] == [(3, 120, 0), (4, 77, 0)]
    assert [(label.episode, label.step, label.critical_state) for label in second] == [(3, 120, 0), (4, 77, 0)]
    assert (first[1].where, second[1].where) == ("labels.csv, line 3", "labels.yaml, entry 2")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("labels.txt", "", "must end in .csv, .yaml or .yml"),
        ("labels.csv", "episode,step,critical_state\n3,here,0\n", "line 2: 'step' must be a whole number, got 'here'"),
        ("labels.csv", "episode,step,critical_state\n3,-4,0\n", "'step' must be a whole number, got '-4'"),
        ("labels.csv", "episode,frame,critical_state\n3,4,0\n", "unknown key 'frame'"),
        ("labels.csv", "episode,step\n3,4\n", "'critical_state' is missing"),
        ("labels.csv", "episode,step,critical_state\n3,4,0\n3,9,0\n", "already labelled at labels.csv, line 2"),
        ("labels.yaml", "episode: 3", "must hold a list of entries"),
        ("labels.yaml", "- 3", "entry 1: expected the keys episode, step, critical_state, got 3"),
        ("labels.yaml", "- {episode: 3, step: 4, critical_stat: 0}", "did you mean 'critical_state'"),
        ("labels.yaml", "- {episode: 3, step: 4.5, critical_state: 0}", "'step' must be a whole number, got 4.5"),
        ("labels.yaml", "- {episode: true, step: 4, critical_state: 0}", "'episode' must be a whole number, got True"),
        ("labels.yaml", "[", "cannot be read"),
    ],
)
def test_bad_labels_are_refused_in_one_sentence(tmp_path: Path, name: str, text: str, message: str):
    with pytest.raises(InvalidLabels) as refusal:
        read_labels(write(tmp_path, name, text))
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(InvalidLabels, match=r"absent\.csv' does not exist"):
        read_labels(tmp_path / "absent.csv")
