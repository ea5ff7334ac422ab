"""A trained policy, ready to act: arrays in, arrays out, reproducible row by row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from juicer.episode import ACTION_SIZE, ArraySpec
from juicer.errors import ConfigError, InvalidCheckpoint, InvalidObservation
from juicer.policy.condition import Condition
from juicer.policy.modes import densest
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
MOST_SAMPLES_AT_ONCE = 256
"""Samples of one row that go through the network together."""


class TrainedPolicy:
    """Acts on batches of observations with fixed weights.

    Attributes:
        observes: What it sees, and what its network is taught with beside. Weights may have come from a policy that was
            taught with more, which the manifest of a checkpoint says: whoever knows that replaces this by it.
    """

    def __init__(
        self, network: PolicyNetwork, task: str, threads: int = 1, device: str = "cpu", samples: int = 1
    ) -> None:
        """Let a network act on one of its tasks.

        Args:
            network: What acts; it is moved to the device.
            task: Assembly task that is to be done.
            threads: Threads of a processor that it may use.
            device: Torch device that computes the actions. Noise is drawn on the processor, whatever the device.
            samples: Chunks that are drawn at each prediction; of several, the one where they are densest is executed.

        Raises:
            InvalidCheckpoint: If it was not trained for the task.
            ConfigError: If there is no such device, or samples of a policy that always predicts the same.
        """
        if samples > 1 and not network.config.draws_samples:
            raise ConfigError(f"a head of kind '{network.config.head.kind}' has no samples to choose among")
        if task not in network.tasks:
            raise InvalidCheckpoint(f"the policy was trained for {', '.join(network.tasks)}, not for '{task}'")
        self.observes = network.encoders.account
        self._device = usable_device(device)
        self._network = network.eval().requires_grad_(False).to(self._device)
        self._task = task
        self._threads = threads
        self._samples = samples
        self._rows = ROWS_OF_IMAGES if network.encoders.sees_images else INFERENCE_ROWS

    @property
    def draws_samples(self) -> bool:
        """Whether what it predicts depends on noise."""
        return self._network.config.draws_samples

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
        draw = self._one_each if self._samples == 1 else self._densest_each
        chunks = draw(self._checked(observations, len(streams)), streams)
        return chunks[:, self._executed].clip(-ACTION_LIMIT, ACTION_LIMIT)

    def sample(
        self, observations: Mapping[str, NDArray[Any]], streams: Sequence[np.random.Generator], number: int
    ) -> Iterator[NDArray[np.float32]]:
        """Many chunks of each of N episodes, an episode at a time: what may be done next, not what will be.

        Args:
            observations: As for :meth:`predict`.
            streams: One generator an episode, from which the noise of all its samples is drawn.
            number: Samples of each.

        Yields:
            Absolute actions ``(number, T_p, 10)`` from the first observed step on, robot base frame, as the network
            predicts them; they depend on their own observation, stream and number only.

        Raises:
            InvalidObservation: As :meth:`predict`.
        """
        for _, chunks in self._sampled(self._checked(observations, len(streams)), streams, number):
            yield chunks

    @property
    def _executed(self) -> slice:
        """Actions of a chunk that are executed."""
        first = self.obs_horizon - 1
        return slice(first, first + self.action_horizon)

    @property
    def _chunk(self) -> tuple[int, int]:
        return (self._network.config.horizons.pred, ACTION_SIZE)

    def _one_each(
        self, rows: Mapping[str, NDArray[Any]], streams: Sequence[np.random.Generator]
    ) -> NDArray[np.float32]:
        """A chunk ``(N, T_p, 10)`` of every row."""
        noise = np.stack([stream.standard_normal(self._chunk, dtype=np.float32) for stream in streams])
        chunks = np.empty_like(noise)
        for batch, padded in self._batches(rows):
            with torch.inference_mode(), compute_settings(self._threads, "highest"):
                chunk = self._network.predict(padded, self._tensor(noise[batch]))
            chunks[batch] = chunk[: batch.stop - batch.start].cpu().numpy()
        return chunks

    def _densest_each(
        self, rows: Mapping[str, NDArray[Any]], streams: Sequence[np.random.Generator]
    ) -> NDArray[np.float32]:
        """The same, of each row the sample whose executed actions lie where those of all are densest."""
        chosen = [
            chunks[densest(normalised[:, self._executed])]
            for normalised, chunks in self._sampled(rows, streams, self._samples)
        ]
        return np.stack(chosen)

    def _sampled(
        self, rows: Mapping[str, NDArray[Any]], streams: Sequence[np.random.Generator], number: int
    ) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Samples ``(number, T_p, 10)`` of every row, normalised and as absolute actions.

        A row is observed once. Its samples make batches of their own, so nothing depends on other rows.
        """
        for batch, padded in self._batches(rows):
            with torch.inference_mode(), compute_settings(self._threads, "highest"):
                condition = self._network.encoders(self._network.encoders.prepare(padded))
            for place, stream in enumerate(streams[batch]):
                own = {name: tokens[place : place + 1] for name, tokens in condition.items()}
                proprioception = padded["proprioception"][place : place + 1, -1]
                noise = stream.standard_normal((number, *self._chunk), dtype=np.float32)
                yield self._samples_of(own, proprioception, noise)

    def _samples_of(
        self, condition: Condition, proprioception: torch.Tensor, noise: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        normalised, chunks = np.empty_like(noise), np.empty_like(noise)
        with torch.inference_mode(), compute_settings(self._threads, "highest"):
            for start in range(0, len(noise), MOST_SAMPLES_AT_ONCE):
                batch = slice(start, min(start + MOST_SAMPLES_AT_ONCE, len(noise)))
                size = batch.stop - batch.start
                repeated = {name: tokens.expand(size, *tokens.shape[1:]) for name, tokens in condition.items()}
                chunk = self._network.head.sample(repeated, torch.from_numpy(noise[batch]).to(self._device))
                normalised[batch] = chunk.cpu().numpy()
                chunks[batch] = self._network.decode_actions(chunk, proprioception.expand(size, -1)).cpu().numpy()
        return normalised, chunks

    def _batches(self, rows: Mapping[str, NDArray[Any]]) -> Iterator[tuple[slice, dict[str, torch.Tensor]]]:
        """Rows in batches that are filled up, and which rows are in each."""
        number = len(next(iter(rows.values())))
        for start in range(0, number, self._rows):
            batch = slice(start, min(start + self._rows, number))
            yield batch, {name: self._tensor(values[batch]) for name, values in rows.items()}

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
