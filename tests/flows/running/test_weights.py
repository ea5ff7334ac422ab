"""A run that lacks pretrained weights says so before it begins."""

from __future__ import annotations

import pwd
import sys
from dataclasses import replace

import pytest

from benchmarks import paper_scale
from flows.running.plan import plan, require_weights
from flows.running.settings import Settings
from flows.runs import load_runs
from juicer.artifacts.store import ArtifactStore
from juicer.errors import UnusableWeights
from juicer.policy.pretrained.files import DEFAULT_FOLDER, places

SEEING = """
flow: study
seeds: [0]
policies:
  seeing:
    policy:
      observation:
        proprioception: {kind: proprioception}
        images: {kind: images, backbone: {kind: resnet, weights: resnet18_imagenet}}
      head: {kind: mlp}
conditions:
  bc_seeing: {title: "BC, images", policy: seeing}
"""


@pytest.fixture
def planned(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "seeing.yaml").write_text(SEEING)
    (config,) = load_runs(tmp_path / "seeing.yaml")
    return plan(ArtifactStore(tmp_path / "store"), config)


def test_a_run_that_lacks_a_file_of_weights_is_refused_before_it_begins(planned, tmp_path):
    with pytest.raises(UnusableWeights, match=rf"'resnet18-f37072fd\.pth' are not on this machine.*'{tmp_path}/w/"):
        require_weights(planned, tmp_path / "w")


def test_the_benchmark_at_the_papers_scale_is_refused_at_once_and_can_start_from_random_weights(monkeypatch, tmp_path):
    monkeypatch.setenv("JUICER_WEIGHTS", str(tmp_path))
    monkeypatch.setattr(sys, "argv", ["paper_scale", "--preset", "paper_image", "--device", "cpu"])
    with pytest.raises(UnusableWeights, match=rf"not on this machine.*'{tmp_path}/"):
        paper_scale.main()
    random = "policies.diffusion.policy.observation.eyes.backbone.weights=null"
    monkeypatch.setattr(sys, "argv", [*sys.argv, "--set", random])
    chosen = paper_scale.configured(paper_scale.arguments())
    require_weights(plan(ArtifactStore(tmp_path / "store"), chosen), tmp_path)


def test_what_is_trained_already_needs_no_file(planned, tmp_path):
    require_weights([replace(each, exists=each.stage == "train" or each.exists) for each in planned], tmp_path)


def test_the_digest_and_not_the_place_is_a_part_of_what_is_trained(planned):
    (train,) = (each for each in planned if each.stage == "train")
    weights = train.call.recipe.config["policy"]["observation"]["images"]["backbone"]["weights"]
    assert weights == {
        "file": "resnet18-f37072fd.pth",
        "sha256": "f37072fd47e89c5e827621c5baffa7500819f7896bbacec160b1a16c560e07ec",
        "licence": weights["licence"],
        "part": "",
    }
    assert not [name for name in train.call.recipe.modules if name.endswith((".known", "pretrained.files"))]
    assert "juicer.policy.backbones.resnet.network" in train.call.recipe.modules


def test_the_folder_of_weights_is_a_setting(monkeypatch, tmp_path):
    assert Settings().machine.weights == DEFAULT_FOLDER.expanduser()
    monkeypatch.setenv("JUICER_WEIGHTS", str(tmp_path / "weights"))
    assert Settings().machine.weights == tmp_path / "weights"


def test_a_user_without_a_home_has_weights_in_the_data_folder(monkeypatch, tmp_path):
    def nobody(number):
        raise KeyError(number)

    monkeypatch.delenv("HOME")
    monkeypatch.setattr(pwd, "getpwuid", nobody)
    monkeypatch.setenv("JUICER_DATA", str(tmp_path))
    folder = Settings().machine.weights
    assert folder == tmp_path / "weights"
    assert list(places("resnet18-f37072fd.pth", folder)) == [folder / "resnet18-f37072fd.pth"]
    assert list(places("resnet18-f37072fd.pth", DEFAULT_FOLDER)) == []
