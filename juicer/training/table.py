"""Windows as rows of tensors: what never changes is computed once, so a training step only gathers rows."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from juicer.errors import TrainingFailed
from juicer.policy.config import TASK_KEY
from juicer.policy.encoder import Prepared
from juicer.policy.network import PolicyNetwork
from juicer.training.config import OriginalStateNoise, PhysicalStateNoise, StateNoise
from juicer.training.source import Batch
from juicer.training.state_noise import perturb_observations, perturb_prepared
from juicer.training.windows import TrainingEpisodes, Windows

ENCODED_AT_ONCE = 8192
"""Windows whose actions are encoded together, to bound memory."""


class WindowTable:
    """The windows of some episodes in memory, with their features and action chunks.

    Rows cost ``4 * 10 * T_p`` bytes a window and ``4 * F`` a step: about 1.6 kB, 90 MB for 60,000 steps. Images stay
    where they are, and a batch takes what it needs.
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
        encoders = network.encoders
        numbers = [spec.name for spec in encoders.training_numbers] + [TASK_KEY] * (len(network.tasks) > 1)
        self._observations = {name: values.to(device) for name, values in _shown(episodes, numbers).items()}
        # They stay outside the device, and mostly outside the memory: a batch takes what it needs.
        self._images = _shown(episodes, [spec.name for spec in encoders.training_images])
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

    @property
    def image_bytes(self) -> int:
        """See :class:`juicer.training.source.WindowSource`."""
        return self._obs_steps.shape[1] * sum(images[0].nbytes for images in self._images.values())

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
        self._prepared = self._network.encoders.prepare_training({**self._observations, **self._images})

    @torch.no_grad()
    def gather(self, rows: Tensor, noise: StateNoise | None = None) -> Batch:
        """See :class:`juicer.training.source.WindowSource`."""
        steps = self._obs_steps[rows]
        prepared = _rows(self._prepared, steps)
        chunk = self._chunks[rows]
        num_noisy = round(noise.probability * len(rows)) if noise else 0
        if isinstance(noise, PhysicalStateNoise):
            seen = perturb_observations(_rows({**self._observations, **self._images}, steps[:num_noisy]), noise)
            for name, values in self._network.encoders.prepare_training(seen).items():
                prepared[name][:num_noisy] = values
            absolute = self._actions[self._action_steps[rows[:num_noisy]]]
            chunk[:num_noisy] = self._network.encode_actions(absolute, seen["proprioception"][:, -1])
        elif isinstance(noise, OriginalStateNoise):
            clean = {name: values[:num_noisy] for name, values in prepared.items()}
            for name, values in perturb_prepared(clean, noise, self._network.encoders).items():
                prepared[name][:num_noisy] = values
        return Batch(prepared, chunk, self._weights[rows])

    def recorded(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """See :class:`juicer.training.source.WindowSource`."""
        current = self._obs_steps[rows, -1]
        return self._actions[self._action_steps[rows]], self._observations["proprioception"][current]

    def _encode_all(self, proprioception: Tensor) -> Tensor:
        blocks = [slice(start, start + ENCODED_AT_ONCE) for start in range(0, len(self), ENCODED_AT_ONCE)]
        encode = self._network.frame.encode
        return torch.cat([encode(self._actions[self._action_steps[rows]], proprioception[rows]) for rows in blocks])


def _rows(arrays: Mapping[str, Tensor], steps: Tensor) -> dict[str, Tensor]:
    """Rows ``(B, T_o, ...)`` of arrays, on the device of the steps, wherever the arrays are."""
    return {name: values[steps.to(values.device)].to(steps.device) for name, values in arrays.items()}


def _shown(episodes: TrainingEpisodes, names: Sequence[str]) -> dict[str, Tensor]:
    """Some of the arrays of episodes.

    Raises:
        TrainingFailed: If there is no such array.
    """
    for name in names:
        if name not in episodes.observations:
            raise TrainingFailed(
                f"the policy observes '{name}', which the episodes do not hold; they hold "
                f"{', '.join(sorted(episodes.observations))}"
            )
    with warnings.catch_warnings():
        # Images lie in files that are mapped to be read: to map them to be changed would count as memory.
        warnings.filterwarnings("ignore", "The given NumPy array is not writable")
        return {name: torch.from_numpy(episodes.observations[name]) for name in names}
