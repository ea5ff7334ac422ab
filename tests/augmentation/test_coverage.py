"""Snippets go where nothing has been yet, and rather where rollouts failed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from juicer.augmentation.augment import FailedAttempt, Snippet, augment
from juicer.augmentation.config import FAR, AugmentationConfig, CoveragePlacement
from juicer.augmentation.coverage import Coverage
from juicer.augmentation.plan import plan_departure
from juicer.augmentation.reference import Reference
from juicer.episode import Episode, Outcome, Source
from juicer.seeding import stream
from tests.augmentation.test_augment import critical
from tests.reader import Reader

PLACEMENT = CoveragePlacement(candidates=2)


def aside(reference: Reference, along_x_m: float) -> np.ndarray:
    """A departure of a single step."""
    return np.asarray(reference.pose, dtype=np.float64)[None] + np.eye(1, 9) * along_x_m


def chosen(coverage: Coverage, reference: Reference, *along_x_m: float) -> float:
    departure = coverage.choose((aside(reference, each) for each in along_x_m), reference)
    return round(float(departure[-1, 0] - reference.pose[0]), 6)


def rollout(insertion: Episode, outcome: Outcome, steps: int, along_x_m: float = 0.0) -> Episode:
    """The first steps of a demonstration as those of a policy, seen to end aside."""
    arrays = {name: values[:steps].copy() for name, values in insertion.steps.items()}
    arrays["proprioception"][-1, 0] += along_x_m
    record = replace(insertion.record, source=Source.ROLLOUT, outcome=outcome, episode_id="")
    return Episode(record, arrays, {name: insertion.steps[name][steps] for name in insertion.final})


def test_the_departure_that_leads_farthest_from_what_was_visited_is_made(reference: Reference):
    coverage = Coverage(PLACEMENT, [reference])
    assert chosen(coverage, reference, 0.01, 0.02) == 0.02
    coverage.visit([(aside(reference, 0.022), reference.pose)])
    assert chosen(coverage, reference, 0.01, 0.02) == 0.01


def test_what_the_demonstration_did_around_its_critical_state_counts_as_visited(reference: Reference):
    coverage = Coverage(PLACEMENT, [reference])
    # It comes from above and goes down; beside that it has never been.
    on_its_way = np.asarray(reference.phase[:1], dtype=np.float64)
    departure = coverage.choose(iter([on_its_way, aside(reference, 0.004)]), reference)
    assert departure is not on_its_way


def test_more_snippets_begin_where_rollouts_failed(reference: Reference, insertions: list[Episode]):
    coverage = Coverage(PLACEMENT, [reference])
    assert chosen(coverage, reference, 0.02, -0.021) == -0.021
    coverage.look_at(rollout(insertions[0], Outcome.TIMEOUT, 17, along_x_m=0.02))
    assert chosen(coverage, reference, 0.02, -0.021) == 0.02


def test_a_place_where_rollouts_succeeded_is_not_visited_again(reference: Reference, insertions: list[Episode]):
    coverage = Coverage(PLACEMENT, [reference])
    coverage.look_at(rollout(insertions[0], Outcome.SUCCESS, 17, along_x_m=0.02))
    assert chosen(coverage, reference, 0.02, 0.01) == 0.01


def test_rollouts_that_hold_nothing_where_the_demonstration_holds_a_part_tell_nothing(
    reference: Reference, insertions: list[Episode]
):
    opened = rollout(insertions[0], Outcome.TIMEOUT, 17, along_x_m=0.02)
    opened.steps["action"][:, 9] = -1
    coverage = Coverage(PLACEMENT, [reference])
    coverage.look_at(opened)
    assert chosen(coverage, reference, 0.02, -0.021) == -0.021


def nearest_neighbours(ends: list[np.ndarray]) -> np.ndarray:
    points = np.array(ends)
    distances = np.linalg.norm(points[:, None] - points[None], axis=-1) + np.eye(len(points))
    return distances.min(axis=1)


def test_as_many_departures_lie_farther_apart_than_drawn_ones(reference: Reference):
    coverage, rng = Coverage(CoveragePlacement(candidates=16), [reference]), stream(0, "test")
    drawn = [plan_departure(reference.pose, FAR, rng) for _ in range(60)]
    placed = []
    for _ in range(60):
        departure = coverage.choose((plan_departure(reference.pose, FAR, rng) for _ in range(16)), reference)
        coverage.visit([(departure, reference.pose)])
        placed.append(departure)
    apart = [nearest_neighbours([each[-1, :3] for each in departures]) for departures in (drawn, placed)]
    assert np.median(apart[1]) > 1.5 * np.median(apart[0])


@pytest.mark.parametrize("workers", [1, 3])
def test_placed_snippets_depend_on_the_seed_alone(insertions: list[Episode], workers: int):
    config = AugmentationConfig(num_snippets=3, placement=CoveragePlacement())
    rollouts = [Reader([rollout(insertions[1], Outcome.TIMEOUT, 17)])]

    def run(num_workers: int) -> list[Snippet | FailedAttempt]:
        annotations = [critical(episode) for episode in insertions]
        demonstrations = Reader(insertions)
        return list(augment(demonstrations, annotations, config, seed=0, rollouts=rollouts, num_workers=num_workers))

    ids = [[each.episode.record.episode_id for each in run(n) if isinstance(each, Snippet)] for n in (workers, 2)]
    assert ids[0] == ids[1]
    assert len(ids[0]) == 3
