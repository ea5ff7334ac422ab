"""How well a policy does on episodes it was not trained on."""

from __future__ import annotations

import torch
from torch import Tensor

from juicer.policy.actions import POSITION, ROTATION
from juicer.policy.network import PolicyNetwork
from juicer.policy.rotations import rot6d_to_matrix
from juicer.seeding import stream
from juicer.training.source import WindowSource

VALIDATION_ROWS = 1024
"""Windows that a validation looks at; always the same ones."""
VALIDATION_SEED = 0
IMAGE_BYTES = 2**22
"""Of images that go through a network at once; what it makes of them takes about a hundred times the room."""


@torch.no_grad()
def validate(network: PolicyNetwork, source: WindowSource) -> dict[str, float]:
    """Loss, and errors of the chunk that would be executed; always with the same windows and the same noise.

    Returns:
        ``validation/loss``; ``validation/position_error_mm``, mean distance between predicted and recorded target
        positions over those of the T_a executed actions that are learned; ``validation/rotation_error_deg`` likewise;
        and ``validation/gripper_accuracy``, share of them whose gripper command has the right sign.
    """
    order = stream(VALIDATION_SEED, "validation").permutation(len(source))[:VALIDATION_ROWS]
    was_training = network.training
    network.eval()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(VALIDATION_SEED)
        parts = [_judge(network, source, rows) for rows in torch.split(torch.from_numpy(order), _at_once(source))]
    network.train(was_training)
    losses, weights, chunks, demonstrated = zip(*parts, strict=True)
    targets = torch.stack([each.sum() for each in weights])
    shares = targets / targets.sum()
    horizons = network.config.horizons
    executed = slice(horizons.obs - 1, horizons.obs - 1 + horizons.action)
    predicted, recorded = torch.cat(chunks)[:, executed], torch.cat(demonstrated)[:, executed]
    counted = torch.cat(weights)[:, executed, 0]

    def mean(values: Tensor) -> float:
        return float((values * counted).sum() / counted.sum())

    distance_m = (predicted - recorded)[..., POSITION].norm(dim=-1)
    same_sign = (predicted[..., 9] > 0) == (recorded[..., 9] > 0)
    return {
        "validation/loss": float((torch.stack(losses) * shares).sum()),
        "validation/position_error_mm": 1000 * mean(distance_m),
        "validation/rotation_error_deg": mean(_angle_rad(predicted, recorded).rad2deg()),
        "validation/gripper_accuracy": mean(same_sign.float()),
    }


def _judge(network: PolicyNetwork, source: WindowSource, rows: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Loss of some windows, which of their actions are targets, the actions that are predicted, and those recorded."""
    device = next(network.parameters()).device
    batch = source.gather(rows).to(device)
    recorded, proprioception = (values.to(device) for values in source.recorded(rows))
    loss = batch.average(network.compute_loss(batch.prepared, batch.chunk))
    predicted = network.act(batch.prepared, proprioception, torch.randn(recorded.shape).to(device))
    return loss, batch.weight, predicted, recorded


def _at_once(source: WindowSource) -> int:
    """Windows that a memory holds with all that a network makes of their images."""
    return max(1, min(VALIDATION_ROWS, IMAGE_BYTES // max(1, source.image_bytes)))


def _angle_rad(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    first_matrix, second_matrix = rot6d_to_matrix(first[..., ROTATION]), rot6d_to_matrix(second[..., ROTATION])
    # Frobenius distance = 2 sqrt(2) sin(angle / 2), which is well conditioned for small angles.
    distance = (first_matrix - second_matrix).flatten(-2).norm(dim=-1)
    return 2 * torch.asin((distance / 8**0.5).clamp(max=1))
