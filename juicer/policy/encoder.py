"""From an observation to the condition vector of a network."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import torch
from torch import Tensor, nn

from juicer.policy.config import FeatureSpec, StateObservationConfig
from juicer.policy.features import observation_sizes, state_features
from juicer.policy.normalizer import Normalizer

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
    """State features, normalised; nothing here is learned by gradient."""

    def __init__(self, spec: FeatureSpec, config: StateObservationConfig, obs_horizon: int) -> None:
        super().__init__()
        self.spec = spec
        self.config = config
        self.sizes = observation_sizes(spec)
        blank = {name: torch.zeros(1, size) for name, size in self.sizes.items()}
        num_features = state_features(blank, spec, config).shape[-1]
        self.normalizer = Normalizer((num_features,))
        self.condition_size = obs_horizon * num_features

    def fit(self, observations: Mapping[str, Tensor]) -> None:
        """Take the limits of every feature."""
        self.normalizer.fit(state_features(observations, self.spec, self.config))

    def prepare(self, observations: Mapping[str, Tensor]) -> Prepared:
        """Normalised features, bounded so that a state unlike any demonstrated does not blow up the network."""
        features = self.normalizer.normalize(state_features(observations, self.spec, self.config))
        return {"state": features.clamp(-self.config.clip, self.config.clip)}

    def forward(self, prepared: Prepared) -> Tensor:
        """Features of the observed steps, side by side."""
        return prepared["state"].flatten(1)
