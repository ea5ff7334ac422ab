"""The commit that runs is named, or honestly not."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from juicer.artifacts.commit import CHANGED, UNKNOWN, commit_of


def git(folder: Path, *arguments: str) -> str:
    names = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    command = ["git", "-C", str(folder), *names, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def package(tmp_path: Path) -> Path:
    package = tmp_path / "checkout" / "package"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    git(package.parent, "init", "-q")
    git(package.parent, "add", ".")
    git(package.parent, "commit", "-qm", "first")
    return package


def test_a_checkout_names_its_commit(package: Path):
    assert commit_of(package) == UNKNOWN or len(commit_of(package)) == 40
    (package / "empty.py").write_text("a = 1\n")
    git(package.parent, "add", ".")
    assert commit_of(package).endswith(CHANGED)
    git(package.parent, "commit", "-qm", "second")
    assert commit_of(package) == git(package, "rev-parse", "HEAD")


def test_a_package_installed_within_another_repository_is_not_of_its_commit(package: Path):
    installed = package.parent / "venv" / "site-packages" / "juicer"
    installed.mkdir(parents=True)
    (installed / "__init__.py").write_text("")
    assert commit_of(installed) == UNKNOWN


def test_without_repository_or_git_the_commit_is_unknown(
    tmp_path: Path, package: Path, monkeypatch: pytest.MonkeyPatch
):
    assert commit_of(tmp_path) == UNKNOWN
    assert commit_of(tmp_path / "gone") == UNKNOWN
    monkeypatch.setenv("PATH", str(tmp_path))
    assert commit_of(package) == UNKNOWN


def test_variables_of_git_do_not_lead_astray(package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (package / "empty.py").write_text("a = 1\n")
    git(package.parent, "add", ".")
    git(package.parent, "commit", "-qm", "second")
    expected = git(package, "rev-parse", "HEAD")
    monkeypatch.setenv("GIT_DIR", str(tmp_path / "elsewhere"))
    assert commit_of(package) == expected
