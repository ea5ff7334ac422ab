"""``juicer doctor --encoders``: which weights are there, and where the others come from."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace

import pytest

from flows.command.cli import call
from flows.doctor.encoders import FileState, examine_encoders
from juicer.policy.pretrained import files, known
from juicer.policy.pretrained.known import KNOWN, ROWS


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of weights of a user who has nothing else."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("JUICER_WEIGHTS", str(tmp_path / "weights"))
    monkeypatch.setattr(files, "find_spec", lambda name: None)
    (tmp_path / "weights").mkdir()
    return tmp_path / "weights"


@pytest.fixture
def resnet18(folder, monkeypatch):
    """A file that is the right one."""
    monkeypatch.setitem(
        known.KNOWN,
        "resnet18_imagenet",
        replace(KNOWN["resnet18_imagenet"], sha256=hashlib.sha256(b"right").hexdigest()),
    )
    path = folder / KNOWN["resnet18_imagenet"].file
    path.write_bytes(b"right")
    return path


def states(folder):
    return {each.row.title: each.state for each in examine_encoders(folder)}


def test_every_encoder_of_the_paper_is_there_and_says_what_it_lacks(folder):
    found = list(examine_encoders(folder))
    assert [each.row for each in found] == list(ROWS)
    for each in found:
        assert each.state is (FileState.MISSING if each.row.weights else FileState.NONE)
        if each.row.weights:
            assert each.path == folder / KNOWN[each.row.weights].file
            assert str(each.path) in each.remedy or each.remedy.startswith("pip install")


def test_a_file_is_present_wherever_it_lies_if_it_is_the_right_one(folder, resnet18, tmp_path):
    assert states(folder)["ResNet18, ImageNet"] is FileState.PRESENT
    cached = tmp_path / "home/.cache/torch/hub/checkpoints" / resnet18.name
    cached.parent.mkdir(parents=True)
    resnet18.rename(cached)
    resnet18.write_bytes(b"wrong")
    assert states(folder)["ResNet18, ImageNet"] is FileState.PRESENT
    cached.unlink()
    assert states(folder)["ResNet18, ImageNet"] is FileState.DIFFERS


def test_of_a_file_without_a_published_digest_it_says_what_to_write(folder):
    (folder / "r3m_18.pt").write_bytes(b"anything")
    digest = hashlib.sha256(b"anything").hexdigest()
    (found,) = (each for each in examine_encoders(folder) if each.row.weights == "r3m_18")
    assert found.state is FileState.UNPINNED
    assert f"weights: {{file: r3m_18.pt, sha256: {digest}, licence: MIT}}" in found.remedy


def test_what_cannot_be_read_is_a_finding(folder):
    (folder / "r3m_18.pt").mkdir()
    assert states(folder)["R3M, ResNet18"] is FileState.UNREADABLE


def test_the_command_prints_a_table_and_json(folder, resnet18, capsys):
    assert call(["doctor", "--encoders"]) == 0
    shown = capsys.readouterr().out
    assert all(row.title in shown for row in ROWS)
    assert f"vip: download it from {KNOWN['vip'].url} and save it as '{folder}/vip_resnet50.pt'" in shown
    assert "r3m_18: get it by `load_r3m('resnet18')` of the package at https://github.com/facebookresearch/" in shown
    assert f"'~/.r3m/r3m_18/model.pt', or as '{folder}/r3m_18.pt'" in shown
    assert call(["doctor", "--encoders", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["folder"] == str(folder)
    assert {each["encoder"]: each["state"] for each in content["encoders"]} == states(folder)


def test_another_file_of_a_known_name_is_a_problem(folder, resnet18, capsys):
    resnet18.write_bytes(b"wrong")
    assert call(["doctor", "--encoders"]) == 1
    assert f"remove '{resnet18}' and download it again" in capsys.readouterr().out
