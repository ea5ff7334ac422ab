"""The page about one's own demonstrations is an example that runs, from the first step recorded to labels."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from flows.command.recordings import find_recordings, say_recordings
from flows.config import RunConfig
from flows.loop import get_demonstrations
from flows.runs import load_runs
from juicer.annotation.propose import AnnotationConfig
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.storage.annotations import read_annotations
from juicer.storage.episodes import EpisodeReader
from stages.annotate import annotate
from stages.runtime.execution import perform_here
from stages.runtime.session import Session

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "demonstrations.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where somebody has followed the page."""
    folder = tmp_path_factory.mktemp("mine")
    (folder / "presets").symlink_to(ROOT / "configs" / "presets")
    (folder / "labels.csv").write_text(blocks("csv")[0])
    for name, text in zip(("mine.yaml", "labelled.yaml"), blocks("yaml"), strict=False):
        (folder / name).write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        exec(blocks("python")[0], {})
    return folder


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return Session(ArtifactStore(tmp_path_factory.mktemp("store")), perform_here)


@pytest.fixture
def config(folder: Path, monkeypatch: pytest.MonkeyPatch) -> RunConfig:
    monkeypatch.chdir(folder)
    (config,) = load_runs(folder / "labelled.yaml")
    return config


@pytest.fixture
def demonstrations(session: Session, config: RunConfig) -> ArtifactRef:
    return get_demonstrations(session, config)


def test_the_table_in_the_page_is_the_one_that_is_printed(session: Session, demonstrations: ArtifactRef, capsys: Any):
    say_recordings(find_recordings(session.store, demonstrations))
    _, shown = blocks("text")[0].split("\n", 1)
    # Another processor's arithmetic gives other digits.
    printed, shown = (re.sub(r"\b[0-9a-f]{16}\b", "id", text) for text in (capsys.readouterr().out, shown))
    assert printed == shown


def test_the_labels_in_the_page_are_used(session: Session, demonstrations: ArtifactRef, config: RunConfig):
    ref = annotate(session, episodes=demonstrations, labels=config.labels, config=AnnotationConfig())
    rows = read_annotations(session.store.open(ref))
    # The table in the page says that 4 and 8 steps before were dropped.
    ids = list(EpisodeReader(session.store.open(demonstrations)).ids)
    assert [(row.episode_id, row.step, row.author) for row in rows] == [(ids[0], 142, "human"), (ids[1], 164, "human")]
