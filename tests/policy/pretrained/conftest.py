import hashlib
import io

import pytest
import torch

from juicer.policy.pretrained.config import Weights


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of weights of a user who has nothing else."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return tmp_path / "weights"


@pytest.fixture
def store(folder):
    """Puts a file there, of tensors or of bytes, and says what a configuration would call it."""

    def put(content, name="mine.pth", **more):
        if not isinstance(content, bytes):
            buffer = io.BytesIO()
            torch.save(content, buffer)
            content = buffer.getvalue()
        folder.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
        return Weights(file=name, sha256=hashlib.sha256(content).hexdigest(), licence="MIT", **more)

    return put
