"""Which episodes a dataset takes, which belong together, and what weights mixing gives them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
from pydantic import ValidationError

from juicer.episode import EpisodeRecord, Outcome, Source
from juicer.errors import ArtifactError, NothingLeft
from juicer.storage.dataset import DatasetRow
from juicer.training.mixing import SYNTHETIC, DatasetConfig, GivenEpisodes, mix

DEMOS, SNIPPETS, ROLLOUTS = "d" * 16, "a" * 16, "b" * 16


def record(identity: str, source: str = "teleop", parent: str | None = None, task: str = "one_leg") -> EpisodeRecord:
    return EpisodeRecord(Source(source), task, "low", 0, Outcome.SUCCESS, parent=parent, episode_id=identity)


def given(artifact: str, *records: EpisodeRecord, length: int = 10) -> GivenEpisodes:
    return GivenEpisodes(artifact, records, [length] * len(records))


EVERYTHING = (
    given(DEMOS, *(record(f"d{number}") for number in range(12)), length=100),
    given(SNIPPETS, record("s0", "augmentation", "d11"), record("s1", "augmentation", "d2")),
    given(ROLLOUTS, record("r0", "rollout"), record("r1", "rollout"), length=50),
)


def mixed(
    judged: dict[str, bool] | None = None, data: Sequence[GivenEpisodes] = EVERYTHING, **config: Any
) -> list[DatasetRow]:
    return mix(data, judged or {}, DatasetConfig(**config))


def test_by_default_everything_is_taken_in_its_order_and_weighs_the_same() -> None:
    rows = mixed()
    assert [row.episode_id for row in rows] == [*(f"d{number}" for number in range(12)), "s0", "s1", "r0", "r1"]
    assert {row.weight for row in rows} == {1.0}
    assert {row.episodes for row in rows} == {DEMOS, SNIPPETS, ROLLOUTS}


def test_a_demonstration_and_all_that_was_grown_from_it_are_one_family() -> None:
    family = {row.episode_id: row.family for row in mixed()}
    assert family["s0"] == family["d11"] == "0/11"
    assert family["s1"] == family["d2"] == "0/2"
    assert len(set(family.values())) == 14


def test_families_do_not_depend_on_the_ids_of_artifacts() -> None:
    """Ids change with the code; the split into training and validation must not."""
    renamed = [GivenEpisodes(each.artifact[::-1] + "0", each.records, each.lengths) for each in EVERYTHING]
    assert [row.family for row in mixed(data=renamed)] == [row.family for row in mixed()]


def test_what_grew_from_what_grew_belongs_to_the_first() -> None:
    data = (given(DEMOS, record("d0")), given(SNIPPETS, record("s0", parent="d0"), record("s1", parent="s0")))
    assert {row.family for row in mixed(data=data)} == {"0/0"}


def test_those_whose_demonstration_is_elsewhere_stay_together_all_the_same() -> None:
    data = (given(SNIPPETS, record("s0", parent="gone"), record("s1", parent="gone"), record("s2", parent="lost")),)
    assert [row.family for row in mixed(data=data)] == ["gone", "gone", "lost"]


def test_episodes_that_grow_from_each_other_end() -> None:
    data = (given(SNIPPETS, record("s0", parent="s1"), record("s1", parent="s0"), record("s2", parent="s2")),)
    assert len(mixed(data=data)) == 3


def test_what_a_selection_rejects_is_left_out() -> None:
    assert "r0" not in {row.episode_id for row in mixed({"r0": False, "r1": True})}


def test_an_artifact_of_which_nothing_is_kept_is_named() -> None:
    with pytest.raises(NothingLeft, match=f"episodes/{ROLLOUTS} holds nothing to learn from; leave it out"):
        mixed({"r0": False, "r1": False})


def test_a_selection_of_other_episodes_is_refused() -> None:
    with pytest.raises(ArtifactError, match="judges episode r9, which is in none of the episodes given"):
        mixed({"r9": True})


def test_an_episode_that_is_there_twice_is_refused() -> None:
    with pytest.raises(ArtifactError, match=f"episode d3 of episodes/{ROLLOUTS} is in other episodes given, too"):
        mixed(data=(*EVERYTHING[:2], given(ROLLOUTS, record("d3"))))


def test_sources_and_tasks_can_be_chosen() -> None:
    assert {row.source for row in mixed(sources=("teleop", "rollout"))} == {Source.TELEOP, Source.ROLLOUT}
    lamp = given("e" * 16, record("l0", task="lamp"))
    assert [row.episode_id for row in mixed(data=(*EVERYTHING, lamp), tasks=("lamp",))] == ["l0"]
    with pytest.raises(NothingLeft, match="no episode is of the sources and tasks"):
        mixed(tasks=("lamp",))


def test_sources_can_be_weighed() -> None:
    weights = {row.source: row.weight for row in mixed(weights={"rollout": 0.5})}
    assert weights == {Source.TELEOP: 1.0, Source.AUGMENTATION: 1.0, Source.ROLLOUT: 0.5}


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_synthetic_data_get_the_share_of_the_steps_that_is_asked_for(share: float) -> None:
    length = {row.episode_id: {DEMOS: 100, SNIPPETS: 10, ROLLOUTS: 50}[row.episodes] for row in mixed()}
    rows = mixed(synthetic_share=share, weights={"rollout": 0.5})
    steps = {row.episode_id: row.weight * length[row.episode_id] for row in rows}
    synthetic = sum(steps[row.episode_id] for row in rows if row.source in SYNTHETIC)
    assert synthetic / sum(steps.values()) == pytest.approx(share)
    weights = {row.source: row.weight for row in rows}
    assert weights[Source.ROLLOUT] == pytest.approx(0.5 * weights[Source.AUGMENTATION])


def test_a_share_of_what_is_not_there_changes_nothing() -> None:
    assert {row.weight for row in mixed(data=EVERYTHING[:1], synthetic_share=0.5)} == {1.0}


@pytest.mark.parametrize(
    "config",
    [
        {"synthetic_share": 0},
        {"synthetic_share": 1},
        {"weights": {"rollout": 0}},
        {"weights": {"rollout": float("nan")}},
        {"weights": {"dreams": 1}},
        {"sources": ()},
        {"sources": ("dreams",)},
        {"tasks": ("chair",)},
        {"weight": 1},
    ],
)
def test_a_mixture_that_makes_no_sense_is_refused(config: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        DatasetConfig(**config)
