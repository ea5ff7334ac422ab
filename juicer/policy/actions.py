"""The frame in which a policy thinks of actions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal

import torch
from torch import Tensor

from juicer.policy.rotations import matrix_to_rot6d, rot6d_to_matrix

POSITION = slice(0, 3)
ROTATION = slice(3, 9)
"""Where end-effector position (m) and rotation (6D) stand in proprioception, and the target's in an action."""


class ActionFrame(ABC):
    """Translates absolute action chunks ``(B, T_p, 10)`` given the proprioception ``(B, 16)`` they start from."""

    @abstractmethod
    def encode(self, absolute: Tensor, proprioception: Tensor) -> Tensor:
        """Actions as the policy predicts them."""

    @abstractmethod
    def decode(self, encoded: Tensor, proprioception: Tensor) -> Tensor:
        """Absolute actions: target position (m, robot base frame), rotation 6D of a true rotation, gripper."""


class AbsoluteFrame(ActionFrame):
    """Targets in the robot base frame, as recorded."""

    def encode(self, absolute: Tensor, proprioception: Tensor) -> Tensor:
        """The actions themselves."""
        return absolute

    def decode(self, encoded: Tensor, proprioception: Tensor) -> Tensor:
        """The actions with their rotations made orthonormal."""
        rotation = matrix_to_rot6d(rot6d_to_matrix(encoded[..., ROTATION]))
        return torch.cat([encoded[..., POSITION], rotation, encoded[..., 9:]], dim=-1)


class RelativeFrame(ActionFrame):
    """Targets relative to the end effector: displacement in base axes (m), rotation in the gripper's own axes."""

    def encode(self, absolute: Tensor, proprioception: Tensor) -> Tensor:
        """Subtract the current end-effector pose."""
        position, matrix = _gripper_pose(proprioception)
        rotation = matrix_to_rot6d(matrix.transpose(-1, -2) @ rot6d_to_matrix(absolute[..., ROTATION]))
        return torch.cat([absolute[..., POSITION] - position, rotation, absolute[..., 9:]], dim=-1)

    def decode(self, encoded: Tensor, proprioception: Tensor) -> Tensor:
        """Add the current end-effector pose."""
        position, matrix = _gripper_pose(proprioception)
        rotation = matrix_to_rot6d(matrix @ rot6d_to_matrix(encoded[..., ROTATION]))
        return torch.cat([encoded[..., POSITION] + position, rotation, encoded[..., 9:]], dim=-1)


def action_frame(name: Literal["absolute", "relative"]) -> ActionFrame:
    """Frame of that name."""
    return AbsoluteFrame() if name == "absolute" else RelativeFrame()


def _gripper_pose(proprioception: Tensor) -> tuple[Tensor, Tensor]:
    """Position ``(B, 1, 3)`` and rotation matrix ``(B, 1, 3, 3)``, ready to broadcast over a chunk."""
    matrix = rot6d_to_matrix(proprioception[..., ROTATION])
    return proprioception[..., None, POSITION], matrix.unsqueeze(-3)
