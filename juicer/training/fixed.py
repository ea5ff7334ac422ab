"""Encoders that are not trained: what they prepare of a step is a column, computed once for all trainings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from juicer.policy.encoder import build_encoder
from juicer.policy.members import EncoderConfig
from juicer.policy.pretrained.loading import load_pretrained
from juicer.policy.torch_settings import compute_settings, usable_device

THREADS = 1


class FixedEncoder:
    """Computes columns of steps.

    Attributes:
        observes: Names of what it sees.
        specs: The columns.
    """

    def __init__(self, config: EncoderConfig, weights: Path, device: str) -> None:
        """Build it, and give it the weights that it starts from and keeps.

        Args:
            config: What it is made of.
            weights: Where files of pretrained weights are looked for first.
            device: Torch device that computes.

        Raises:
            UnusableWeights: If the file of its weights is missing or another one.
            ConfigError: If there is no such device.
        """
        self._device = usable_device(device)
        self._encoder = build_encoder(config, {}, obs_horizon=1).requires_grad_(False).eval()
        load_pretrained(self._encoder, weights)
        self._encoder.to(self._device)
        self.observes = tuple(spec.name for spec in self._encoder.observations)
        self.specs = self._encoder.training_observations

    def columns(self, observations: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[np.float32]]:
        """Entries of the columns ``(N, ...)`` for observations ``(N, ...)``."""
        seen = {name: torch.from_numpy(values).to(self._device) for name, values in observations.items()}
        with torch.inference_mode(), compute_settings(THREADS, "highest"):
            prepared = self._encoder.prepare(seen)
        parts = [prepared] if isinstance(prepared, torch.Tensor) else list(prepared.values())
        return {spec.name: part.float().cpu().numpy() for spec, part in zip(self.specs, parts, strict=True)}
