"""Which offsets from a critical state have been visited, and where snippets are still wanted.

An offset is how far the end effector is from its pose at a critical state: position (m, robot base frame) and rotation
vector, both in units of a :class:`~juicer.augmentation.config.CoveragePlacement`. So distances between offsets are
numbers without a unit, and 1 is about as far as a policy is likely to generalise by itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from juicer.augmentation.config import CoveragePlacement
from juicer.augmentation.plan import POSE_SIZE
from juicer.augmentation.reference import Reference
from juicer.episode import DemonstrationReader, Episode, Outcome
from juicer.geometry import matrix_to_rotvec, rot6d_to_matrix
from juicer.gripper import gripper_commands

if TYPE_CHECKING:
    from scipy.spatial import KDTree

Array = NDArray[np.float64]

NEARBY_M = 0.2
"""Poses of rollouts that are farther away from every critical state are passed over: no departure leads there."""


class Coverage:
    """What has been visited around one critical state, and where rollouts failed."""

    def __init__(self, placement: CoveragePlacement, references: Sequence[Reference]) -> None:
        """Begin with what the demonstrations themselves show.

        Args:
            placement: Units of offsets, and how many candidates there are.
            references: All those of one critical state, at least one.
        """
        self.placement = placement
        self._references = references
        self._visited = _Offsets(self._offset(each.phase, each.pose) for each in references)
        self._failed = _Offsets()

    def visit(self, returns: Iterable[tuple[NDArray[np.floating[Any]], NDArray[np.floating[Any]]]]) -> None:
        """Note the poses ``(N, 9)`` on the ways back of snippets, each with the critical pose ``(9,)`` it leads to."""
        self._visited.add(self._offset(poses, critical) for poses, critical in returns)

    def look_at(self, rollout: Episode) -> None:
        """Note where a successful rollout went, or where another ended.

        A rollout has no critical state of its own: its poses are compared with the nearest demonstrated one.
        """
        if rollout.record.outcome is Outcome.SUCCESS:
            self._visited.add([self._nearby(rollout, slice(None))])
        else:
            self._failed.add([self._nearby(rollout, slice(-1, None))])

    def choose(self, drawn: Iterator[NDArray[np.float64]], reference: Reference) -> NDArray[np.float64]:
        """The departure that leads farthest away from everything visited, rather close to where rollouts failed.

        Args:
            drawn: Departures as :func:`juicer.augmentation.plan.plan_departure` gives them; the first ones are
                candidates.
            reference: The critical state that they leave.
        """
        candidates = list(islice(drawn, self.placement.candidates))
        ends = np.array([each[-1] if len(each) else reference.pose for each in candidates])
        offsets = self._offset(ends, reference.pose)
        wanted = self._visited.distance(offsets)
        if self._failed:
            wanted = wanted / (1.0 + self._failed.distance(offsets))
        return candidates[int(np.argmax(wanted))]

    def _nearby(self, rollout: Episode, steps: slice) -> Array:
        """Offsets of a rollout's poses near the critical state, while the gripper does what it does there."""
        poses = np.asarray(rollout.steps["proprioception"], dtype=np.float64)[steps, :POSE_SIZE]
        poses = poses[gripper_commands(rollout.steps["action"])[steps] == self._references[0].gripper]
        origins = np.array([each.pose for each in self._references], dtype=np.float64)
        distances = np.linalg.norm(poses[:, None, :3] - origins[None, :, :3], axis=-1)
        nearest = distances.argmin(axis=1)
        near = distances.min(axis=1) < NEARBY_M
        return self._offset(poses[near], origins[nearest[near]])

    def _offset(self, poses: NDArray[np.floating[Any]], origin: NDArray[np.floating[Any]]) -> Array:
        """Offsets ``(N, 6)`` of poses ``(N, 9)`` from one pose or from as many."""
        poses, origin = np.asarray(poses, dtype=np.float64), np.asarray(origin, dtype=np.float64)
        moved = (poses[:, :3] - origin[..., :3]) / self.placement.position_m
        turned = np.swapaxes(rot6d_to_matrix(origin[..., 3:]), -1, -2) @ rot6d_to_matrix(poses[:, 3:])
        return np.concatenate([moved, matrix_to_rotvec(turned) / math.radians(self.placement.rotation_deg)], axis=1)


class _Offsets:
    """Offsets ``(N, 6)``, of which the nearest one is found quickly."""

    def __init__(self, parts: Iterable[Array] = ()) -> None:
        self._parts = list(parts)
        self._tree: KDTree | None = None

    def __bool__(self) -> bool:
        return any(map(len, self._parts))

    def add(self, parts: Iterable[Array]) -> None:
        self._parts += parts
        self._tree = None

    def distance(self, offsets: Array) -> Array:
        """Distance of each offset from the nearest of these; infinitely far from none."""
        from scipy.spatial import KDTree  # takes half a second to import

        if not self:
            return np.full(len(offsets), np.inf)
        self._tree = self._tree or KDTree(np.concatenate(self._parts))
        return np.asarray(self._tree.query(offsets)[0])


def coverages(
    by_state: dict[int, list[Reference]], placement: CoveragePlacement, rollouts: Sequence[DemonstrationReader]
) -> dict[int, Coverage]:
    """Coverage of each critical state by demonstrations and rollouts."""
    found = {state: Coverage(placement, references) for state, references in by_state.items()}
    for rollout in (reader.read(number) for reader in rollouts for number in range(len(reader))):
        for coverage in found.values():
            coverage.look_at(rollout)
    return found
