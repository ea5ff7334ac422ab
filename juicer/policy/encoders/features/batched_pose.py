"""Poses in batches, in torch."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor

from juicer.policy.rotations import matrix_to_rot6d, rotate_back


class BatchedPose(NamedTuple):
    """Poses of one frame in another.

    Attributes:
        position: ``(..., 3)`` [m].
        matrix: Rotations ``(..., 3, 3)``.
    """

    position: Tensor
    matrix: Tensor

    def seen_from(self, frame: BatchedPose) -> BatchedPose:
        """The same in another frame, both given in a third."""
        offset = rotate_back(frame.matrix, self.position - frame.position)
        return BatchedPose(offset, frame.matrix.transpose(-1, -2) @ self.matrix)

    def carrying(self, other: BatchedPose) -> BatchedPose:
        """Where something is that is given in this frame."""
        moved = (self.matrix @ other.position.unsqueeze(-1)).squeeze(-1)
        return BatchedPose(self.position + moved, self.matrix @ other.matrix)

    def numbers(self) -> list[Tensor]:
        """What a network is shown of them: position ``(..., 3)`` and 6D rotation ``(..., 6)``."""
        return [self.position, matrix_to_rot6d(self.matrix)]
