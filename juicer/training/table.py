"""Windows as rows of tensors: what never changes is computed once, so a training step only gathers rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from juicer.errors import TrainingFailed
from juicer.policy.encoder import Prepared
from juicer.policy.network import PolicyNetwork
from juicer.seeding import stream
from juicer.training.config import OriginalStateNoise, PhysicalStateNoise, StateNoise
from juicer.training.state_noise import perturb_observations, perturb_prepared
from juicer.training.windows import TrainingEpisodes, Windows

ENCODED_AT_ONCE = 8192
"""Windows whose actions are encoded together, to bound memory."""


@dataclass(frozen=True)
class Batch:
    """Windows ready for the network.

    Attributes:
        prepared: Prepared observations ``(B, T_o, F)``.
        chunk: Encoded, normalised actions ``(B, T_p, 10)``.
        weight: ``(B, T_p, 1)`` one where an action is a target, zero where not.
    """

    prepared: Prepared
    chunk: Tensor
    weight: Tensor

    def average(self, losses: Tensor) -> Tensor:
        """Mean over the targets of losses ``(B, T_p, 10)``."""
        return (losses * self.weight).sum() / (self.weight.sum() * losses.shape[-1])


class WindowTable:
    """Windows of some episodes with their features and action chunks.

    Rows cost ``4 * 10 * T_p`` bytes a window and ``4 * F`` a step: about 1.6 kB, 90 MB for 60,000 steps.
    """

    def __init__(
        self,
        episodes: TrainingEpisodes,
        windows: Windows,
        network: PolicyNetwork,
        learn_padding: bool,
        device: torch.device,
    ) -> None:
        if not len(windows):
            raise TrainingFailed(
                f"no episode is long enough for a window of {network.config.horizons.pred} actions; "
                "raise windows.back_padding"
            )
        self._network = network
        self._observations = {
            name: torch.from_numpy(values).to(device) for name, values in episodes.observations.items()
        }
        self._actions = torch.from_numpy(episodes.actions).to(device)
        self._obs_steps = torch.from_numpy(windows.obs_steps).to(device)
        self._action_steps = torch.from_numpy(windows.action_steps).to(device)
        is_target = windows.is_recorded | learn_padding
        self._weights = torch.from_numpy(is_target.astype(np.float32)[..., None]).to(device)
        self._chunks = self._encode_all(self._observations["proprioception"][self._obs_steps[:, -1]])
        self._prepared: Prepared = {}

    def __len__(self) -> int:
        """Number of windows."""
        return len(self._obs_steps)

    def fit(self, noise: StateNoise | None = None) -> None:
        """Give the network the limits of what these windows will show it, physical state noise included."""
        seen = {name: values[self._obs_steps] for name, values in self._observations.items()}
        chunks = self._chunks
        if isinstance(noise, PhysicalStateNoise):
            noisy = perturb_observations(seen, noise)
            chunks = torch.cat([chunks, self._encode_all(noisy["proprioception"][:, -1])])
            seen = {name: torch.cat([values, noisy[name]]) for name, values in seen.items()}
        self._network.encoders.fit(seen)
        self._network.action_normalizer.fit(chunks)

    def normalize(self) -> None:
        """Apply the network's limits; needed once before batches are taken."""
        self._chunks = self._network.action_normalizer.normalize(self._chunks)
        self._prepared = self._network.encoders.prepare(self._observations)

    @torch.no_grad()
    def batch(self, rows: Tensor, noise: StateNoise | None = None) -> Batch:
        """Gather windows; noise falls on the leading rows, so ``rows`` must be in random order for it."""
        steps = self._obs_steps[rows]
        prepared = {name: values[steps] for name, values in self._prepared.items()}
        chunk = self._chunks[rows]
        num_noisy = round(noise.probability * len(rows)) if noise else 0
        if isinstance(noise, PhysicalStateNoise):
            seen = {name: values[steps[:num_noisy]] for name, values in self._observations.items()}
            seen = perturb_observations(seen, noise)
            for name, values in self._network.encoders.prepare(seen).items():
                prepared[name][:num_noisy] = values
            absolute = self._actions[self._action_steps[rows[:num_noisy]]]
            chunk[:num_noisy] = self._network.encode_actions(absolute, seen["proprioception"][:, -1])
        elif isinstance(noise, OriginalStateNoise):
            clean = {name: values[:num_noisy] for name, values in prepared.items()}
            for name, values in perturb_prepared(clean, noise, self._network.encoders).items():
                prepared[name][:num_noisy] = values
        return Batch(prepared, chunk, self._weights[rows])

    def recorded(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Absolute actions ``(B, T_p, 10)`` and current proprioception ``(B, 16)`` of windows."""
        current = self._obs_steps[rows, -1]
        return self._actions[self._action_steps[rows]], self._observations["proprioception"][current]

    def _encode_all(self, proprioception: Tensor) -> Tensor:
        blocks = [slice(start, start + ENCODED_AT_ONCE) for start in range(0, len(self), ENCODED_AT_ONCE)]
        encode = self._network.frame.encode
        return torch.cat([encode(self._actions[self._action_steps[rows]], proprioception[rows]) for rows in blocks])


class BatchOrder:
    """Which windows each training step sees: every window once an epoch, shuffled anew.

    The rows of a step are a function of the seed and the step alone, so that a resumed training needs no memory
    of the order.
    """

    def __init__(self, num_windows: int, batch_size: int, seed: int) -> None:
        self._num_windows = num_windows
        self._batch_size = batch_size
        self._seed = seed
        self._epoch = -1
        self._shuffled: NDArray[np.int64] = np.empty(0, dtype=np.int64)

    def rows(self, step: int) -> Tensor:
        """Indices ``(batch_size,)`` of the windows of a step; a batch may reach into the next epoch."""
        start, end = step * self._batch_size, (step + 1) * self._batch_size
        parts = []
        while start < end:
            epoch, offset = divmod(start, self._num_windows)
            part = self._shuffle(epoch)[offset : offset + end - start]
            parts.append(part)
            start += len(part)
        return torch.from_numpy(np.concatenate(parts))

    def _shuffle(self, epoch: int) -> NDArray[np.int64]:
        if epoch != self._epoch:
            self._epoch = epoch
            self._shuffled = stream(self._seed, "order", epoch).permutation(self._num_windows)
        return self._shuffled
