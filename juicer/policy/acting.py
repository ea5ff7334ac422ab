"""A trained policy, ready to act: arrays in, arrays out, reproducible row by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from juicer.episode import ACTION_SIZE, ArraySpec
from juicer.errors import InvalidCheckpoint, InvalidObservation
from juicer.policy.network import PolicyNetwork
from juicer.policy.tasks import PART_POSES, as_shown, size_of_part_poses
from juicer.policy.torch_settings import compute_settings, usable_device

ACTION_LIMIT = 1.0
"""Largest entry of an action that a robot takes; a regression overshoots its training range now and then."""

INFERENCE_ROWS = 16
"""Rows of every batch that goes through the network.

Matrix products may differ in their last digits between batch sizes. Each batch is therefore filled up to this
size, so that what a row yields never depends on how many others are asked for beside it.
"""
ROWS_OF_IMAGES = 8
"""The same for policies that see images, which cost more than all the rest."""


class TrainedPolicy:
    """Acts on batches of observations with fixed weights."""

    def __init__(self, network: PolicyNetwork, task: str, threads: int = 1, device: str = "cpu") -> None:
        """Let a network act on one of its tasks.

        Args:
            network: What acts; it is moved to the device.
            task: Assembly task that is to be done.
            threads: Threads of a processor that it may use.
            device: Torch device that computes the actions. Noise is drawn on the processor, whatever the device.

        Raises:
            InvalidCheckpoint: If it was not trained for the task.
            ConfigError: If there is no such device.
        """
        if task not in network.tasks:
            raise InvalidCheckpoint(f"the policy was trained for {', '.join(network.tasks)}, not for '{task}'")
        self._device = usable_device(device)
        self._network = network.eval().requires_grad_(False).to(self._device)
        self._task = task
        self._threads = threads
        self._rows = ROWS_OF_IMAGES if network.encoders.sees_images else INFERENCE_ROWS

    @property
    def observations(self) -> tuple[ArraySpec, ...]:
        """What :meth:`predict` wants to see."""
        return self._network.encoders.observations

    @property
    def obs_horizon(self) -> int:
        """T_o, observations that :meth:`predict` wants to see."""
        return self._network.config.horizons.obs

    @property
    def action_horizon(self) -> int:
        """T_a, actions that :meth:`predict` returns."""
        return self._network.config.horizons.action

    def predict(
        self, observations: Mapping[str, NDArray[Any]], streams: Sequence[np.random.Generator]
    ) -> NDArray[np.float32]:
        """Next actions of N episodes.

        Args:
            observations: Those of :attr:`observations`, the last ``T_o`` of each, oldest first, ``(N, T_o, *shape)``;
                with ``T_o`` of one, that axis may be left out.
            streams: One generator an episode, from which the noise of its row is drawn.

        Returns:
            Absolute actions ``(N, T_a, 10)``, robot base frame, entries within [-1, 1]; a row depends on nothing
            but its own observation and stream.

        Raises:
            InvalidObservation: If an array is missing, has another shape or type, or holds a non-finite value.
        """
        rows = self._checked(observations, len(streams))
        horizons = self._network.config.horizons
        shape = (horizons.pred, ACTION_SIZE)
        noise = np.stack([stream.standard_normal(shape, dtype=np.float32) for stream in streams])
        first = horizons.obs - 1
        actions = np.empty((len(streams), horizons.action, ACTION_SIZE), dtype=np.float32)
        with torch.inference_mode(), compute_settings(self._threads, "highest"):
            for start in range(0, len(streams), self._rows):
                batch = slice(start, min(start + self._rows, len(streams)))
                padded = {name: self._tensor(values[batch]) for name, values in rows.items()}
                chunk = self._network.predict(padded, self._tensor(noise[batch]))
                actions[batch] = chunk[: batch.stop - start, first : first + horizons.action].cpu().numpy()
        return actions.clip(-ACTION_LIMIT, ACTION_LIMIT)

    def _tensor(self, rows: NDArray[Any]) -> torch.Tensor:
        return torch.from_numpy(_fill_up(rows, self._rows)).to(self._device)

    def _checked(self, observations: Mapping[str, NDArray[Any]], num_rows: int) -> dict[str, NDArray[Any]]:
        rows = {}
        for spec in self.observations:
            if spec.name not in observations:
                raise InvalidObservation(f"the policy needs '{spec.name}', got only {sorted(observations)}")
            rows[spec.name] = self._values(spec, np.asarray(observations[spec.name]), num_rows)
        return as_shown(rows, self._network.tasks, self._task)

    def _values(self, spec: ArraySpec, given: NDArray[Any], num_rows: int) -> NDArray[Any]:
        shape = spec.shape
        if spec.name == PART_POSES:
            shape = (size_of_part_poses(self._network.tasks[self._task]),)
        values = given[:, None] if self.obs_horizon == 1 and given.ndim == 1 + len(shape) else given
        expected = (num_rows, self.obs_horizon, *shape)
        if values.shape != expected:
            raise InvalidObservation(
                f"'{spec.name}' must have shape {expected} (streams, T_o, size), got {given.shape}"
            )
        if not np.can_cast(values.dtype, spec.dtype, "same_kind"):
            raise InvalidObservation(f"'{spec.name}' must be of type {spec.dtype}, got {values.dtype}")
        if not np.isfinite(values).all():
            raise InvalidObservation(f"'{spec.name}' holds NaN or infinite values")
        return values.astype(spec.dtype, copy=False)


def _fill_up(rows: NDArray[Any], number: int) -> NDArray[Any]:
    """So many rows, the last one repeated."""
    return np.concatenate([rows, np.repeat(rows[-1:], number - len(rows), axis=0)])
