from __future__ import annotations

import os
from pathlib import Path

import pytest

from juicer.annotation.labels import read_labels
from juicer.errors import InvalidLabels


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_csv_and_yaml_say_the_same(tmp_path: Path):
    table = write(tmp_path, "labels.csv", "recording,step,critical_state\n3, 120, 0\n4, 77, 0\n")
    listing = write(
        tmp_path,
        "labels.yaml",
        "- {recording: 3, step: 120, critical_state: 0}\n- {recording: 4, step: 77, critical_state: 0}\n",
    )
    first, second = read_labels(table), read_labels(listing)
    assert [(label.recording, label.step, label.critical_state) for label in first] == [("3", 120, 0), ("4", 77, 0)]
    assert [(label.recording, label.step, label.critical_state) for label in second] == [("3", 120, 0), ("4", 77, 0)]
    assert (first[1].where, second[1].where) == ("labels.csv, line 3", "labels.yaml, entry 2")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("labels.txt", "", "must end in .csv, .jsonl, .yaml or .yml"),
        (
            "labels.csv",
            "recording,step,critical_state\n3,here,0\n",
            "line 2: 'step' must be a whole number, got 'here'",
        ),
        ("labels.csv", "recording,step,critical_state\n3,-4,0\n", "'step' must be a whole number, got '-4'"),
        ("labels.csv", "recording,frame,critical_state\n3,4,0\n", "unknown key 'frame'"),
        ("labels.csv", "recording,step\n3,4\n", "'critical_state' is missing"),
        ("labels.csv", "recording,step,critical_state\n3,4,0\n3,9,0\n", "already labelled at labels.csv, line 2"),
        ("labels.yaml", "recording: 3", "must hold a list of entries"),
        ("labels.yaml", "- 3", "entry 1: expected the keys recording, step, critical_state, got 3"),
        ("labels.yaml", "- {recording: 3, step: 4, critical_stat: 0}", "did you mean 'critical_state'"),
        ("labels.yaml", "- {recording: 3, step: 4.5, critical_state: 0}", "'step' must be a whole number, got '4.5'"),
        ("labels.yaml", "- {recording: '', step: 4, critical_state: 0}", "'recording' must name an episode or a log"),
        ("labels.yaml", "- {recording: a, step: true, critical_state: 0}", "'step' must be a whole number, got 'true'"),
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


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffrecording,step,critical_state\n3,120,0\n",
        "recording,step,critical_state\r\n3,120,0\r\n",
        "recording,step,critical_state\r3,120,0\r",
        "critical_state, step, recording\n0, 120, 3\n\n",
        '"recording","step","critical_state"\n"3","120\n","0"\n',
        "recording,step,critical_state\n3,00120,0",
    ],
)
def test_what_table_editors_write_is_read(tmp_path: Path, text: str):
    (label,) = read_labels(write(tmp_path, "labels.csv", text))
    assert (label.recording, label.step, label.critical_state) == ("3", 120, 0)


def test_numbers_in_yaml_are_decimal_as_in_a_table(tmp_path: Path):
    (label,) = read_labels(write(tmp_path, "labels.yml", "- {recording: 010, step: 0120, critical_state: '0'}"))
    assert (label.recording, label.step) == ("010", 120)


def test_only_plain_files_of_sensible_size_are_read(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "zero.yaml").symlink_to("/dev/zero")
    with (tmp_path / "large.csv").open("wb") as file:
        file.truncate(2**30)
    for name, reason in {
        "pipe.csv": "not a plain file",
        "folder.csv": "not a plain file",
        "zero.yaml": "not a plain file",
        "large.csv": "larger than",
    }.items():
        with pytest.raises(InvalidLabels, match=reason):
            read_labels(tmp_path / name)
