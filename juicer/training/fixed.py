"""Encoders that are not trained: what they derive of a step is a column, computed once for all trainings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from juicer.episode import Role
from juicer.policy.encoder import build_encoder
from juicer.policy.members import EncoderConfig
from juicer.policy.pretrained.loading import load_pretrained
from juicer.policy.tasks import Tasks
from juicer.policy.torch_settings import compute_settings, usable_device

THREADS = 1


class FixedEncoder:
    """Computes columns of steps.

    Attributes:
        observes: Names of what it sees.
        specs: The columns.
    """

    def __init__(
        self, config: EncoderConfig, tasks: Tasks, weights: Path, estimators: Sequence[Path], device: str
    ) -> None:
        """Build it, and give it the weights that it keeps.

        Args:
            config: What it is made of.
            tasks: The task that it sees.
            weights: Where files of pretrained weights are looked for first.
            estimators: Folders of estimators, if it needs one.
            device: Torch device that computes.

        Raises:
            UnusableWeights: If the file of its weights is missing or another one.
            ConfigError: If there is no such device, or it needs an estimator and none or another one was given.
        """
        self._device = usable_device(device)
        self._encoder = build_encoder(config, tasks, obs_horizon=1).requires_grad_(False).eval()
        load_pretrained(self._encoder, weights)
        # Only now, as backbones of estimators start from files, too.
        self._encoder.take_estimators(estimators)
        self._encoder.to(self._device)
        self.observes = tuple(spec.name for spec in self._encoder.observations)
        self.specs = tuple(spec for spec in self._encoder.training_observations if spec.role is Role.DERIVED)

    def columns(self, observations: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[np.float32]]:
        """Entries of the columns ``(N, ...)`` for observations ``(N, ...)``."""
        seen = {name: torch.from_numpy(values).to(self._device) for name, values in observations.items()}
        with torch.inference_mode(), compute_settings(THREADS, "highest"):
            derived = self._encoder.derive(seen)
        return {name: column.float().cpu().numpy() for name, column in derived.items()}
