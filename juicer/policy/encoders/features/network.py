"""Features of a state as the condition of a network: scaled, bounded, and not learned."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from juicer.episode import SIMULATOR
from juicer.policy.config import TASK_KEY
from juicer.policy.encoder import ObservationEncoder
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.encoders.features.features import num_features, state_features
from juicer.policy.normalizer import Normalizer
from juicer.policy.tasks import Tasks

FeaturesOf = Callable[[int, Mapping[str, Tensor]], Tensor]
"""Features ``(..., F)`` of a task, by its number, and observations of it."""


class FeatureEncoder(ObservationEncoder):
    """State features, a token an observed step; normalised task by task, or by limits that all tasks share.

    Tasks differ in their number of parts and features: rows are as long as the longest need, zero behind the others.
    """

    observations = (SIMULATOR["proprioception"], SIMULATOR["part_poses"])
    begins_with_proprioception: ClassVar[bool] = True

    def __init__(self, config: FeaturesConfig, tasks: Tasks, obs_horizon: int) -> None:
        super().__init__()
        self.specs = tuple(tasks.values())
        self.config = config
        lengths = [num_features(spec, config) for spec in self.specs]
        self.token_size = (obs_horizon, max(lengths))
        shared = config.normalisation == "together"
        self.normalizers = nn.ModuleList(Normalizer((size,)) for size in ([max(lengths)] if shared else lengths))

    def fit(self, observations: Mapping[str, Tensor]) -> None:
        """Take the limits of every feature, over the tasks that share a normaliser and have the feature."""
        limits: dict[Normalizer, list[tuple[Tensor, Tensor]]] = {}
        for normalizer, features, _ in self._of_each_task(observations, self._true):
            rows = features.reshape(-1, features.shape[-1])
            absent = (0, len(normalizer.offset) - rows.shape[-1])
            low, high = rows.amin(dim=0), rows.amax(dim=0)
            own = functional.pad(low, absent, value=torch.inf), functional.pad(high, absent, value=-torch.inf)
            limits.setdefault(normalizer, []).append(own)
        for normalizer, found in limits.items():
            low = torch.stack([low for low, _ in found]).amin(dim=0)
            high = torch.stack([high for _, high in found]).amax(dim=0)
            is_seen = low <= high
            normalizer.set_limits(low.where(is_seen, 0), high.where(is_seen, 0))

    def prepare(self, observations: Mapping[str, Tensor]) -> Tensor:
        """Normalised features, bounded so that a state unlike any demonstrated does not blow up the network."""
        return self.scaled(observations, self._true)

    def scaled(self, observations: Mapping[str, Tensor], features_of: FeaturesOf) -> Tensor:
        """The same of features that a function yields of a task, by its number, and observations of it."""
        proprioception = observations["proprioception"]
        state = proprioception.new_zeros(*proprioception.shape[:-1], self.token_size[1])
        for normalizer, features, rows in self._of_each_task(observations, features_of):
            size = features.shape[-1]
            normalised = (features - normalizer.offset[:size]) / normalizer.scale[:size]
            state[(rows, slice(size))] = normalised.clamp(-self.config.clip, self.config.clip)
        return state

    def forward(self, prepared: Tensor) -> Tensor:
        """The features themselves."""
        return prepared

    def _true(self, task: int, observations: Mapping[str, Tensor]) -> Tensor:
        return state_features(observations, self.specs[task], self.config)

    def _of_each_task(
        self, observations: Mapping[str, Tensor], features_of: FeaturesOf
    ) -> Iterator[tuple[Normalizer, Tensor, Any]]:
        """For every task that is there its normaliser, the features of its rows, and where these rows are."""
        for task in range(len(self.specs)):
            normalizer = self.normalizers[task % len(self.normalizers)]
            assert isinstance(normalizer, Normalizer)
            rows = ... if len(self.specs) == 1 else observations[TASK_KEY][..., 0] == task
            if rows is not ... and not bool(rows.any()):
                continue
            own = {name: values[rows] for name, values in observations.items() if name != TASK_KEY}
            yield normalizer, features_of(task, own), rows
