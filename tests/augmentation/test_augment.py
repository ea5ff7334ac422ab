from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from juicer.augmentation import augment as module
from juicer.augmentation.augment import FailedAttempt, Snippet, augment, find_references
from juicer.augmentation.config import AugmentationConfig, ToleranceConfig
from juicer.augmentation.execute import reproduces
from juicer.augmentation.summary import AugmentationSummary
from juicer.augmentation.verify import RejectionReason
from juicer.episode import Episode, Outcome
from juicer.errors import ArtifactError
from juicer.sim.env import AssemblyEnv
from juicer.storage.annotations import Annotation
from juicer.storage.episodes import EpisodeReader, write_episodes
from tests.reader import Reader

STEP = 16
CONFIG = AugmentationConfig(num_snippets=3)


def critical(episode: Episode, critical_state: int = 0, confidence: float = 1.0) -> Annotation:
    return Annotation(episode.record.episode_id, STEP, critical_state, "proposed", confidence)


def run(
    insertions: list[Episode], annotations: Sequence[Annotation] | None = None, **changes: Any
) -> list[Snippet | FailedAttempt]:
    settings: dict[str, Any] = {"config": CONFIG, "seed": 0, "num_workers": 2} | changes
    if annotations is None:
        annotations = [critical(episode) for episode in insertions]
    return list(augment(Reader(insertions), annotations, **settings))


@pytest.fixture(scope="module")
def attempts(insertions: list[Episode]) -> list[Snippet | FailedAttempt]:
    return run(insertions)


def snippets(attempts: Sequence[Snippet | FailedAttempt]) -> list[Snippet]:
    return [attempt for attempt in attempts if isinstance(attempt, Snippet)]


def test_as_many_snippets_as_wanted_come_from_the_demonstrations(
    attempts: list[Snippet | FailedAttempt], insertions: list[Episode]
):
    kept = snippets(attempts)
    assert len(kept) == 3
    assert {snippet.episode.record.parent for snippet in kept} <= {episode.record.episode_id for episode in insertions}
    assert all(snippet.episode.record.critical_state == 0 for snippet in kept)
    assert all(snippet.start[0] > 0 for snippet in kept)


def test_the_number_of_workers_changes_nothing(attempts: list[Snippet | FailedAttempt], insertions: list[Episode]):
    for first, second in zip(attempts, run(insertions, num_workers=3), strict=True):
        if isinstance(first, FailedAttempt):
            assert first == second
            continue
        assert isinstance(second, Snippet)
        assert first.episode.record == second.episode.record
        for name, values in first.episode.steps.items():
            np.testing.assert_array_equal(values, second.episode.steps[name])


def test_another_seed_gives_other_snippets(attempts: list[Snippet | FailedAttempt], insertions: list[Episode]):
    one = CONFIG.model_copy(update={"num_snippets": 1})
    first, second = snippets(attempts)[0], snippets(run(insertions, seed=1, config=one))[0]
    assert first.start != second.start


def test_wanting_fewer_snippets_gives_the_first_of_them(
    attempts: list[Snippet | FailedAttempt], insertions: list[Episode]
):
    few = run(insertions, config=CONFIG.model_copy(update={"num_snippets": 1}), num_workers=1)
    for first, second in zip(few, attempts, strict=False):
        assert isinstance(first, Snippet) == isinstance(second, Snippet)
        assert first.departure == second.departure


def test_critical_states_are_balanced_even_if_one_is_rejected_more_often(
    insertions: list[Episode], monkeypatch: pytest.MonkeyPatch
):
    def judge(
        env: object, reference: Any, config: object, rng: np.random.Generator, *_: object
    ) -> Snippet | FailedAttempt:
        if reference.critical_state == 1 and rng.random() < 0.7:
            return FailedAttempt(reference.parent, 1, "far", RejectionReason.DROPPED)
        record = replace(insertions[0].record, episode_id=str(rng.random()))
        return Snippet(replace(insertions[0], record=record), reference, "far")

    monkeypatch.setattr(module, "attempt_snippet", judge)
    annotations = [critical(insertions[0]), critical(insertions[1]), critical(insertions[0], 1)]
    kept = snippets(run(insertions, annotations, config=AugmentationConfig(num_snippets=200)))
    share = sum(snippet.critical_state == 1 for snippet in kept) / len(kept)
    # One of three annotations, succeeding three times in ten: without the balance the share would be 0.13.
    assert 0.3 < share < 0.45


def test_the_same_snippet_counts_once(insertions: list[Episode], monkeypatch: pytest.MonkeyPatch):
    def judge(env: object, reference: Any, config: object, rng: object, *_: object) -> Snippet:
        return Snippet(insertions[0], reference, "far")

    monkeypatch.setattr(module, "attempt_snippet", judge)
    first, *others = run(insertions, config=AugmentationConfig(num_snippets=2, max_attempts_per_snippet=2))
    assert isinstance(first, Snippet)
    assert [isinstance(each, FailedAttempt) and each.reason for each in others] == [RejectionReason.REPEATED] * 3


def test_uncertain_proposals_and_failures_are_not_used(insertions: list[Episode]):
    failed = replace(insertions[1], record=replace(insertions[1].record, outcome=Outcome.TIMEOUT))
    third = replace(insertions[0], record=replace(insertions[0].record, episode_id="third"))
    annotations = [critical(insertions[0], confidence=0.4), critical(failed), critical(third)]
    references = find_references(Reader([insertions[0], failed, third]), annotations, CONFIG)
    assert [reference.parent for reference in references] == ["third"]


def test_annotations_of_other_episodes_are_refused(insertions: list[Episode]):
    with pytest.raises(ArtifactError, match=r"no demonstration is the annotated episode .*; annotate these"):
        run(insertions[:1], [critical(insertions[1])])


def why_nothing(attempts: list[Snippet | FailedAttempt], config: AugmentationConfig = CONFIG) -> str:
    summary = AugmentationSummary(["insert leg"])
    assert not list(summary.keep(attempts))
    return summary.why_nothing(config)


def test_without_a_critical_state_there_is_nothing_to_do(insertions: list[Episode]):
    attempts = run(insertions, [critical(insertions[0], confidence=0.1)])
    assert attempts == []
    assert "lower augment.min_confidence (now 0.5)" in why_nothing(attempts)


def test_if_every_attempt_fails_the_commonest_reason_is_told(insertions: list[Episode]):
    impossible = AugmentationConfig(
        num_snippets=2, max_attempts_per_snippet=2, tolerance=ToleranceConfig(position_m=1e-9)
    )
    attempts = run(insertions, config=impossible)
    assert "none of 4 attempts succeeded, 4 ended with 'part_position'" in why_nothing(attempts, impossible)


def test_a_snippet_that_does_not_replay_is_rejected(insertions: list[Episode], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "reproduces", lambda env, episode: False)
    config = AugmentationConfig(num_snippets=1, max_attempts_per_snippet=2)
    assert "not_reproduced" in why_nothing(run(insertions, config=config), config)


def test_progress_counts_snippets_and_attempts(insertions: list[Episode]):
    heard: list[tuple[int, int, object]] = []
    run(insertions, progress=lambda done, total, **facts: heard.append((done, total, facts["attempts"])))
    assert heard[-1][:2] == (3, 3)
    assert [attempts for *_, attempts in heard] == list(range(1, len(heard) + 1))


def test_stored_snippets_replay_exactly(attempts: list[Snippet | FailedAttempt], tmp_path: Path):
    write_episodes(tmp_path, (snippet.episode for snippet in snippets(attempts)), {})
    reader = EpisodeReader(tmp_path)
    env = AssemblyEnv("one_leg", max_steps=100_000)
    assert len(reader) == 3
    assert all(reproduces(env, reader.read(index)) for index in range(3))


def test_the_summary_tells_the_yield(attempts: list[Snippet | FailedAttempt]):
    summary = AugmentationSummary(["insert leg"])
    episodes = list(summary.keep(attempts))
    facts = summary.as_json()
    assert facts["snippets"] == len(episodes) == 3
    assert facts["yield"] == 3 / facts["attempts"]
    assert facts["steps"] == sum(map(len, episodes))
    assert sum(facts["start_sideways_mm"].values()) == 3
    assert summary.why_nothing(CONFIG) == ""
    assert facts["by_critical_state"] == {"insert leg": {"attempts": facts["attempts"], "snippets": 3}}
