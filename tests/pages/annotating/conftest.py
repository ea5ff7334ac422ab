"""Demonstrations to annotate, with what was proposed for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from juicer.annotation.versions import versions_path
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Episode
from juicer.storage.annotations import Annotation, write_annotations
from juicer.storage.episodes import write_episodes

RIGHT_STEP = 20

Fill = Callable[..., ArtifactRef]


@pytest.fixture
def fill(tmp_path: Path, insertions: list[Episode]) -> Fill:
    """Fills a store with demonstrations; by the difference of each one's proposal from the right step.

    Where that is none, nothing is proposed. Further arguments are fields of their records.
    """

    def fill(off: Sequence[int | None], **facts: object) -> ArtifactRef:
        store = ArtifactStore(tmp_path / "data")
        episodes = []
        for number in range(len(off)):
            episode = insertions[number % len(insertions)]
            record = replace(episode.record, episode_id=f"{number:016x}", log=f"demo_{number}.npz", **facts)
            episodes.append(replace(episode, record=record))
        ingest = Recipe("ingest", "episodes", config={"task": "one_leg", "episodes": len(off)})
        with store.create(ingest) as draft:
            write_episodes(draft.path, episodes, {})
            draft.summary["episodes"] = len(episodes)
        annotate = Recipe("annotate", "annotations", inputs={"episodes": (ingest.ref,)})
        with store.create(annotate) as draft:
            pairs = zip(episodes, off, strict=True)
            write_annotations(draft.path, [_proposed(each, steps) for each, steps in pairs if steps is not None])
        return ingest.ref

    return fill


@pytest.fixture
def versions(tmp_path: Path) -> Path:
    """Where what is said is kept."""
    return versions_path(tmp_path / "data", "one_leg")


def _proposed(episode: Episode, off: int) -> Annotation:
    return Annotation(episode.record.episode_id, RIGHT_STEP + off, 0, "proposed", 0.4 if off else 0.95)


def propose_for(tmp_path: Path, episode: Episode, states: Mapping[int, int], confidence: float = 0.5) -> ArtifactRef:
    """Fills a store with one episode and proposals for it, steps by critical state."""
    store = ArtifactStore(tmp_path / "data")
    ingest = Recipe("ingest", "episodes", config={"task": episode.record.task})
    with store.create(ingest) as draft:
        write_episodes(draft.path, [episode], {})
    with store.create(Recipe("annotate", "annotations", inputs={"episodes": (ingest.ref,)})) as draft:
        identity = episode.record.episode_id
        rows = [Annotation(identity, step, state, "proposed", confidence) for state, step in states.items()]
        write_annotations(draft.path, rows)
    return ingest.ref
