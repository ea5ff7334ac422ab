"""Critical states that a correction must still contain: what is not yet done where it begins."""

from __future__ import annotations

import numpy as np

from juicer.episode import Episode
from juicer.geometry import quat_to_matrix
from juicer.sim.milestones import TaskProgress
from juicer.tasks.specification import AssemblyTask, CriticalState, Insertion

_MOUNTED = ("inserted", "screwed", "put_on")


def remaining_critical_states(task: AssemblyTask, episode: Episode) -> frozenset[int]:
    """Critical states of a task, by index, that lie ahead of an episode's first state.

    An insertion does until its part is in its place, a grasp until its part is lifted or mounted, that of the base
    until it is in the corner.
    """
    poses = np.asarray(episode.steps["part_poses"][0], np.float64).reshape(-1, 7)
    positions, matrices = poses[:, :3], np.asarray(quat_to_matrix(poses[:, 3:]), np.float64)
    reached = TaskProgress(task).reached(positions, matrices)
    of_part = {pair.second: reached.intersection(pair.milestones) for pair in task.pairs}
    of_part[0] = reached.intersection(task.milestones[:1])

    def lies_ahead(state: CriticalState) -> bool:
        if isinstance(state, Insertion):
            return not any(name.endswith(_MOUNTED) for name in of_part[task.pairs[state.pair].second])
        return not of_part[state.part]

    return frozenset(index for index, state in enumerate(task.critical_states) if lies_ahead(state))
