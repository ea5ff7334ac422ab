"""From an observation to the condition vector of a network."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Any

import torch
from torch import Tensor, nn

from juicer.policy.config import StateObservationConfig
from juicer.policy.features import state_features
from juicer.policy.normalizer import Normalizer
from juicer.policy.tasks import TASK_KEY, Tasks, observation_sizes

Prepared = Mapping[str, Tensor]
"""Named inputs of an encoder, each with one row a step."""


class ObservationEncoder(nn.Module, ABC):
    """Encodes observations in two parts, so that what needs no gradient is computed once for a whole dataset.

    Attributes:
        sizes: Length of every observation array that is needed, by name.
        condition_size: Length C of the condition vector.
    """

    sizes: Mapping[str, int]
    condition_size: int

    @abstractmethod
    def fit(self, observations: Mapping[str, Tensor]) -> None:
        """Learn limits from the observations ``(..., D)`` of the training windows."""

    @abstractmethod
    def prepare(self, observations: Mapping[str, Tensor]) -> Prepared:
        """The fixed part: arrays ``(..., F)`` of observations ``(..., D)``."""

    @abstractmethod
    def forward(self, prepared: Prepared) -> Tensor:
        """The learned part: conditions ``(B, C)`` of prepared rows ``(B, T_o, F)``."""


class StateEncoder(ObservationEncoder):
    """State features, normalised task by task; of several tasks, a learned embedding tells which it is.

    Tasks differ in their number of parts and features: rows are as long as the longest need, zero behind the others.
    """

    def __init__(self, tasks: Tasks, config: StateObservationConfig, obs_horizon: int, task_embedding: int) -> None:
        super().__init__()
        self.specs = tuple(tasks.values())
        self.config = config
        self.sizes = observation_sizes(tasks)
        blank = {name: torch.zeros(1, size) for name, size in self.sizes.items()}
        lengths = [state_features(blank, spec, config).shape[-1] for spec in self.specs]
        self.num_features = max(lengths)
        self.normalizers = nn.ModuleList(Normalizer((length,)) for length in lengths)
        self.embedding = nn.Embedding(len(tasks), task_embedding) if len(tasks) > 1 else None
        self.condition_size = obs_horizon * self.num_features + (task_embedding if self.embedding else 0)

    def fit(self, observations: Mapping[str, Tensor]) -> None:
        """Take the limits of every feature."""
        for normalizer, features, _ in self._features(observations):
            if len(features):
                normalizer.fit(features)

    def prepare(self, observations: Mapping[str, Tensor]) -> Prepared:
        """Normalised features, bounded so that a state unlike any demonstrated does not blow up the network."""
        proprioception = observations["proprioception"]
        state = proprioception.new_zeros(*proprioception.shape[:-1], self.num_features)
        for normalizer, features, rows in self._features(observations):
            normalised = normalizer.normalize(features).clamp(-self.config.clip, self.config.clip)
            state[(rows, slice(features.shape[-1]))] = normalised
        return {"state": state, **{name: observations[name] for name in self.sizes if name == TASK_KEY}}

    def forward(self, prepared: Prepared) -> Tensor:
        """Features of the observed steps side by side, and the task's embedding."""
        state = prepared["state"].flatten(1)
        if self.embedding is None:
            return state
        return torch.cat([state, self.embedding(prepared[TASK_KEY][:, -1, 0].long())], dim=-1)

    def _features(self, observations: Mapping[str, Tensor]) -> Iterator[tuple[Normalizer, Tensor, Any]]:
        """For every task its normaliser, the features of its rows, and where these rows are."""
        for index, (spec, normalizer) in enumerate(zip(self.specs, self.normalizers, strict=True)):
            assert isinstance(normalizer, Normalizer)
            rows = ... if self.embedding is None else observations[TASK_KEY][..., 0] == index
            own = {name: values[rows] for name, values in observations.items()}
            yield normalizer, state_features(own, spec, self.config), rows
