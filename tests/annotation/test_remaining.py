"""What a correction must still contain follows from the state in which it begins."""

from __future__ import annotations

import numpy as np
import pytest

from juicer.annotation.remaining import remaining_critical_states
from juicer.tasks.registry import TASK_NAMES, get_task
from tests.annotation.poses import part_poses
from tests.conftest import EpisodeFactory


def ahead(episode_factory: EpisodeFactory, name: str, mounted: list[int], *, lifted: int | None = None) -> set[int]:
    task = get_task(name)
    episode = episode_factory(9, task=name, num_parts=len(task.parts))
    poses = part_poses(task, mounted)
    if lifted is not None:
        poses[7 * lifted + 2] += 0.2
    episode.steps["part_poses"][0] = poses
    return set(remaining_critical_states(task, episode))


@pytest.mark.parametrize(("name", "count"), zip(TASK_NAMES, [1, 3, 5, 4], strict=True))
def test_everything_lies_ahead_of_a_reset(episode_factory, name, count):
    task = get_task(name)
    start = np.concatenate([part.start for part in task.parts])
    episode = episode_factory(9, task=name, num_parts=len(task.parts))
    episode.steps["part_poses"][0] = start
    assert len(remaining_critical_states(task, episode)) == task.num_critical_states == count


@pytest.mark.parametrize(
    ("name", "mounted", "expected"),
    [
        ("one_leg", [], {0}),
        ("one_leg", [0], set()),
        ("round_table", [0], {1, 2}),
        ("lamp", [0], {3, 4}),
        ("lamp", [0, 1], set()),
        ("square_table", [1, 2], {0, 3}),
    ],
)
def test_only_what_is_not_yet_assembled_lies_ahead(episode_factory, name, mounted, expected):
    assert ahead(episode_factory, name, mounted) == expected


def test_a_part_that_is_lifted_is_grasped_already_but_not_inserted(episode_factory):
    assert ahead(episode_factory, "round_table", [0], lifted=2) == {2}
