"""A store with a small run in it, and the pages on it."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
import uvicorn
from starlette.testclient import TestClient

from flows.servers.addresses import listen_on, port_of
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Outcome
from juicer.pages.application import create_application
from juicer.pages.drawing import renderer_of
from juicer.pages.workplace import Workplace
from juicer.storage.curves import CURVES_FILE
from juicer.storage.episodes import write_episodes
from juicer.storage.evaluations import EXAMPLES, EvaluationRow, write_evaluation

HTML = {"accept": "text/html"}


@dataclass(frozen=True)
class Run:
    """Artifacts of a run, one made from the other."""

    store: ArtifactStore
    logs: ArtifactRef
    episodes: ArtifactRef
    checkpoint: ArtifactRef
    evaluation: ArtifactRef


@pytest.fixture(autouse=True, scope="module")
def _renderers_are_released():
    """Pages keep what draws as long as their process, which here runs other tests next."""
    yield
    renderer_of.cache_clear()


@pytest.fixture
def store(tmp_path) -> ArtifactStore:
    return ArtifactStore(tmp_path / "store")


@pytest.fixture
def client(store: ArtifactStore, tmp_path: Path) -> TestClient:
    return TestClient(create_application(Workplace(store, tmp_path)), headers=HTML)


@pytest.fixture
def address(store: ArtifactStore, tmp_path: Path) -> Iterator[str]:
    """Where the pages are really served."""
    with listen_on("127.0.0.1", 0) as listener:
        application = create_application(Workplace(store, tmp_path))
        server = uvicorn.Server(uvicorn.Config(application, log_level="error", timeout_graceful_shutdown=1))
        thread = threading.Thread(target=server.run, args=([listener],))
        thread.start()
        yield f"http://127.0.0.1:{port_of(listener)}"
        server.should_exit = True
        thread.join()


def commit(store: ArtifactStore, recipe: Recipe, summary: dict[str, object], fill=lambda folder: None) -> ArtifactRef:
    """Make an artifact."""
    with store.create(recipe) as draft:
        fill(draft.path)
        draft.summary.update(summary)
    return draft.ref


def _tasks(names: Sequence[str]) -> dict[str, dict[str, object]]:
    return {name: {} for name in names}


@pytest.fixture
def run(store: ArtifactStore, insertions) -> Run:
    tasks = _tasks(["one_leg"])
    logs = commit(store, Recipe("record", "logs", tasks=tasks), {"headline": "logs 2"})
    episodes = commit(
        store,
        Recipe("ingest", "episodes", {"logs": (logs,)}, tasks=tasks),
        {"headline": "episodes 2", "label": "2 demonstrations"},
        lambda folder: write_episodes(folder, insertions[:2], {}),
    )
    checkpoint = commit(
        store,
        Recipe("train", "checkpoint", {"episodes": (episodes,)}, tasks=tasks),
        {"headline": "steps 20"},
        lambda folder: (folder / CURVES_FILE).write_text('{"train/loss": [[0, 1.0], [10, 0.1], [20, 0.01]]}'),
    )

    def evaluation(folder: Path) -> None:
        kept = insertions[0]
        milestones = dict(kept.record.milestones)
        write_evaluation(
            folder,
            [
                EvaluationRow(0, kept.record.seed, Outcome.SUCCESS, 1, len(kept), milestones),
                EvaluationRow(1, 77, Outcome.TIMEOUT, 0, 600, {"top_placed": 40}),
            ],
        )
        (folder / EXAMPLES).mkdir()
        write_episodes(folder / EXAMPLES, [kept], {})

    summary = {"headline": "success 50%", "success_rate": 0.5, "interval_low": 0.1, "interval_high": 0.9}
    recipe = Recipe("evaluate", "evaluation", {"checkpoint": (checkpoint,)}, tasks=tasks)
    return Run(store, logs, episodes, checkpoint, commit(store, recipe, summary, evaluation))
