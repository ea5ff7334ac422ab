"""Commands and configurations in the documentation are real."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from flows.command.cli import app
from flows.runs import load_runs

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
PLACEHOLDERS = {"NAME": "train", "STAGE": "train", "CONFIG": "configs/demo.yaml"}


def code_blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(), re.DOTALL)


def commands(page: Path, program: str) -> Iterator[list[str]]:
    """Arguments of every call of a program, in blocks and in running text."""
    lines = [line for block in code_blocks(page, "bash") for line in block.replace("\\\n", " ").splitlines()]
    lines += re.findall(r"`([^`\n]+)`", page.read_text())
    for line in lines:
        if line.startswith(f"{program} "):
            yield [PLACEHOLDERS.get(word, word) for word in shlex.split(line, comments=True)[1:]]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_juicer_understands_the_commands_of_a_page(page: Path):
    group = typer.main.get_command(app)
    for name, *arguments in commands(page, "juicer"):
        if name.startswith("-"):
            continue
        assert name in group.commands
        if arguments:
            group.commands[name].make_context(name, arguments)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_make_has_the_targets_that_a_page_names(page: Path):
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M)
    named = {words[0] for words in commands(page, "make")}
    assert named <= set(targets)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_configurations_in_a_page_are_valid(page: Path, tmp_path: Path):
    (tmp_path / "presets").symlink_to(ROOT / "configs" / "presets")
    for block in code_blocks(page, "yaml"):
        path = tmp_path / "example.yaml"
        path.write_text(block)
        load_runs(path)


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda path: path.name)
def test_configurations_that_come_along_are_valid_and_described(path: Path):
    load_runs(path)
    assert f"configs/{path.name}" in (ROOT / "docs" / "configuration.md").read_text()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_between_pages_lead_somewhere(page: Path):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text()):
        assert (page.parent / target).exists(), target


def test_modules_that_the_pages_name_exist():
    for page in PAGES:
        for path in re.findall(
            r"`((?:juicer|stages|flows|tests|docker|configs|scripts)/[\w./-]+\.\w+)`", page.read_text()
        ):
            assert (ROOT / path).exists(), f"{page.name}: {path}"
