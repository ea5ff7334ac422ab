"""The state-noise baseline: perturb what the robot believes about itself, leave its targets where they were.

The absolute target then pulls back to the demonstration. Relative actions must therefore be computed from the
perturbed pose.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from juicer.policy.actions import POSITION, ROTATION
from juicer.policy.encoder import Encoders, Prepared
from juicer.policy.rotations import euler_xyz_to_matrix, matrix_to_rot6d, rot6d_to_matrix
from juicer.training.config import OriginalStateNoise, PhysicalStateNoise


def perturb_observations(observations: Mapping[str, Tensor], noise: PhysicalStateNoise) -> dict[str, Tensor]:
    """Observations ``(B, T_o, D)`` with the end effector displaced, by the same amount in all ``T_o`` steps."""
    moved = _displaced(observations["proprioception"], noise.position_m, noise.rotation_rad)
    return {**observations, "proprioception": moved}


def perturb_prepared(prepared: Prepared, noise: OriginalStateNoise, encoders: Encoders) -> dict[str, Tensor]:
    """What encoders prepared ``(B, T_o, F)``, perturbed like the original's where it begins with the proprioception."""
    moved = {
        name: _displaced(prepared[name], noise.position, noise.rotation_rad)
        for name, encoder in encoders.items()
        if encoder.begins_with_proprioception
    }
    return {**prepared, **moved}


def _displaced(state: Tensor, position: float, rotation_rad: float) -> Tensor:
    """Rows ``(B, T_o, D)`` that begin with position and 6D rotation; the turn is in the gripper's own axes."""
    # Drawn by the processor, wherever the state is: loaders draw there too.
    offset, turn = (torch.randn(len(state), 1, 3).to(state.device, non_blocking=True) for _ in range(2))
    rotation = matrix_to_rot6d(rot6d_to_matrix(state[..., ROTATION]) @ euler_xyz_to_matrix(rotation_rad * turn))
    return torch.cat([state[..., POSITION] + position * offset, rotation, state[..., 9:]], dim=-1)
