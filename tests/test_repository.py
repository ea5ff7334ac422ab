"""What the repository declares is so: dependencies, tested versions, workflows, and the version everywhere."""

from __future__ import annotations

import ast
import importlib.metadata
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from juicer import __version__

ROOT = Path(__file__).parents[1]
GITHUB = ROOT / ".github"
OWN = {"juicer", "stages", "flows", "benchmarks", "tests", "_typeshed"}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# MoviePy, of the extra "video", wants an older Pillow than the tested one.
LOCKED_EXTRAS = ("dev", "s3", "postgres", "spacemouse")


def requirements(*extras: str) -> list[Requirement]:
    texts = [*PROJECT["dependencies"], *(text for extra in extras for text in PROJECT["optional-dependencies"][extra])]
    return [Requirement(text) for text in texts]


def read_constraints() -> dict[str, Version]:
    lines = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
    pairs = [re.fullmatch(r"([\w.-]+)==([\w.!]+)", line) for line in lines]
    assert all(pairs), "every line is NAME==VERSION, without a build or an address"
    return {canonicalize_name(pair[1]): Version(pair[2]) for pair in pairs if pair}


def imported_modules(path: Path) -> Iterator[str]:
    """Top-level names that a file imports."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.split(".")[0]


@pytest.mark.parametrize("was_there", [True, False])
def test_set_up_removes_no_folder_that_it_has_not_made(tmp_path: Path, was_there: bool):
    python, folder = tmp_path / "python", tmp_path / "environment"
    # New enough, and without what makes environments, which leaves half of one.
    python.write_text(f'#!/bin/sh\ncase "$*" in *version*) exit 0;; esac\nmkdir -p "{folder}"\nexit 1\n')
    python.chmod(0o755)
    if was_there:
        folder.mkdir()
        (folder / "work").write_text("of somebody")
    done = subprocess.run(
        ["bash", ROOT / "scripts" / "setup.sh"],
        env={"PATH": os.environ["PATH"], "VENV": str(folder), "PYTHON": str(python)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "cannot create a virtual environment" in done.stderr
    assert [path.name for path in tmp_path.glob("environment/*")] == ["work"] * was_there
    assert folder.exists() is was_there


@pytest.mark.parametrize("path", sorted(ROOT.glob("scripts/*.py")), ids=lambda path: path.stem)
def test_every_script_can_be_started(path: Path):
    """As far as what it imports, which neither mypy nor another test looks at."""
    code = f"import runpy; runpy.run_path({str(path)!r})"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("folders", "extras"),
    [
        (("juicer", "stages", "flows"), ("dask", "ray")),
        (("tests", "benchmarks", "docker", "scripts"), ("dev",)),
    ],
    ids=["source", "tests"],
)
def test_every_library_that_is_imported_is_declared(folders: tuple[str, ...], extras: tuple[str, ...]):
    declared = {canonicalize_name(requirement.name) for requirement in requirements(*extras)}
    owners = importlib.metadata.packages_distributions()
    for path in (path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        for module in set(imported_modules(path)) - OWN - sys.stdlib_module_names:
            names = {canonicalize_name(name) for name in owners.get(module, [module])}
            assert names & declared, f"{path.relative_to(ROOT)} imports '{module}', which pyproject.toml does not name"


def test_every_dependency_has_a_tested_version_within_its_range():
    constraints = read_constraints()
    for requirement in requirements(*LOCKED_EXTRAS):
        version = constraints[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(version), f"{requirement} against {version}"


@pytest.mark.parametrize("name", ["scripts/setup.sh", "docker/Dockerfile"])
def test_set_up_and_image_install_the_tested_versions(name: str):
    text = (ROOT / name).read_text().replace("\\\n", " ")
    installs = [line for line in text.splitlines() if re.search(r"(pip|\[@\]}\") install ", line)]
    assert len(installs) == 2
    assert all("--constraint constraints.txt" in line for line in installs)
    assert not re.search(r"torch[=<>~]=\d", text), "torch's version stands in constraints.txt"


@pytest.mark.parametrize(
    ("schema", "pattern"),
    [
        ("vendor.github-workflows", ".github/workflows/*.yml"),
        ("vendor.dependabot", ".github/dependabot.yml"),
        ("vendor.github-issue-forms", ".github/ISSUE_TEMPLATE/[!c]*.yml"),
        ("vendor.github-issue-config", ".github/ISSUE_TEMPLATE/config.yml"),
        ("vendor.citation-file-format", "CITATION.cff"),
    ],
)
def test_files_for_github_follow_their_schemas(schema: str, pattern: str):
    files = sorted(map(str, ROOT.glob(pattern)))
    assert files
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", schema, *files]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def workflow_commands() -> Iterator[list[str]]:
    for path in (GITHUB / "workflows").glob("*.yml"):
        for job in yaml.safe_load(path.read_text())["jobs"].values():
            for step in job["steps"]:
                yield from (line.split() for line in step.get("run", "").splitlines())


def test_workflows_call_targets_and_scripts_that_exist():
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M)
    called: set[str] = set()
    for program, *arguments in workflow_commands():
        if program == "make":
            called.update(word for word in arguments if "=" not in word)
        if program.startswith("scripts/"):
            assert (ROOT / program).stat().st_mode & 0o100, program
    assert called == {"check", "test", "slow-test"}
    assert called <= set(targets)


def test_version_is_the_same_in_the_package_and_its_citation():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == __version__


def notes_of(version: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["scripts/release_notes.sh", version], cwd=ROOT, capture_output=True, text=True, check=False)


def test_release_notes_are_those_of_one_version(tmp_path: Path):
    (tmp_path / "scripts").mkdir()
    script = tmp_path / "scripts" / "release_notes.sh"
    script.write_text((ROOT / "scripts" / "release_notes.sh").read_text())
    (tmp_path / "CHANGELOG.md").write_text(
        "# Changelog\n\n## Unreleased\n\n- later\n\n## 0.2.0 (2026-12-01)\n\n- ours\n\n## 0.1.0 (2026-11-01)\n\n- old\n"
    )
    done = subprocess.run(["bash", script, "0.2.0"], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "- ours"


def test_a_version_without_notes_is_not_released():
    done = notes_of("99.0.0")
    assert done.returncode != 0
    assert "CHANGELOG.md has no section" in done.stderr


@pytest.mark.parametrize("page", sorted((ROOT / "docs" / "results").glob("*.md")), ids=lambda page: page.name)
def test_results_are_listed_and_their_links_lead_somewhere(page: Path):
    assert page.name == "README.md" or f"]({page.name})" in (page.parent / "README.md").read_text()
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text()):
        assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.name)
def test_pages_for_users_name_no_commits(page: Path):
    words = re.findall(r"\b[0-9a-f]{7}\b", page.read_text())
    assert not [word for word in words if re.search("[a-f]", word) and re.search("[0-9]", word)]
