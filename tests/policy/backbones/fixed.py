"""Weights and images that are the same wherever they are made: what the real libraries made of them is recorded."""

from __future__ import annotations

import zlib

import numpy as np
import torch
from torch import Tensor, nn


def fixed_weights(shapes: dict[str, torch.Size]) -> dict[str, Tensor]:
    """By its name and shape, a value for every weight and statistic of a network."""
    return {name: torch.from_numpy(_value(name, tuple(shape))) for name, shape in shapes.items()}


def fill(network: nn.Module) -> nn.Module:
    network.load_state_dict(fixed_weights({name: value.shape for name, value in network.state_dict().items()}))
    return network.eval()


def fixed_images(height: int, width: int) -> Tensor:
    """Three images, normalised."""
    rng = np.random.default_rng(0)
    coarse = torch.from_numpy(rng.normal(size=(3, 3, 8, 8)).astype(np.float32))
    return nn.functional.interpolate(coarse, (height, width), mode="bilinear", align_corners=True)


def _value(name: str, shape: tuple[int, ...]) -> np.ndarray:
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    if name.endswith("num_batches_tracked"):
        return np.array(100)
    if name.endswith("running_var"):
        return rng.uniform(0.5, 1.5, size=shape).astype(np.float32)
    noise = rng.standard_normal(shape, dtype=np.float32)
    if len(shape) > 1:
        return noise * np.float32(np.prod(shape[1:]) ** -0.5)
    return np.float32(name.endswith("weight")) + 0.1 * noise
