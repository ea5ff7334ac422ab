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

    Attributes:
        specs: Numbers of each task.
        lengths: How many features each task has.
    """

    observations = (SIMULATOR["proprioception"], SIMULATOR["part_poses"])
    begins_with_proprioception: ClassVar[bool] = True

    def __init__(self, config: FeaturesConfig, tasks: Tasks, obs_horizon: int) -> None:
        super().__init__()
        self.specs = tuple(tasks.values())
        self.config = config
        self.lengths = [num_features(spec, config) for spec in self.specs]
        longest = max(self.lengths)
        self.token_size = (obs_horizon, longest)
        shared = config.normalisation == "together"
        self.normalizers = nn.ModuleList(Normalizer((size,)) for size in ([longest] if shared else self.lengths))

    def fit(self, observations: Mapping[str, Tensor]) -> None:
        """Take the limits of every feature, over the tasks that share a normaliser and have the feature."""
        self.fit_to(observations, self._true)

    def fit_to(self, observations: Mapping[str, Tensor], features_of: FeaturesOf) -> None:
        """The same of features that a function yields of a task, by its number, and observations of it."""
        limits: dict[Normalizer, list[tuple[Tensor, Tensor]]] = {}
        for task, shown, _ in self.by_task(observations):
            normalizer, features = self._normalizer(task), features_of(task, shown)
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
        for task, own, rows in self.by_task(observations):
            normalizer, features = self._normalizer(task), features_of(task, own)
            size = features.shape[-1]
            normalised = (features - normalizer.offset[:size]) / normalizer.scale[:size]
            state[(rows, slice(size))] = normalised.clamp(-self.config.clip, self.config.clip)
        return state

    def forward(self, prepared: Tensor) -> Tensor:
        """The features themselves."""
        return prepared

    def by_task(self, observations: Mapping[str, Tensor]) -> Iterator[tuple[int, dict[str, Tensor], Any]]:
        """For every task that is there its number, the observations of its rows, and where these rows are."""
        for task in range(len(self.specs)):
            rows = ... if len(self.specs) == 1 else observations[TASK_KEY][..., 0] == task
            if rows is not ... and not bool(rows.any()):
                continue
            own = {name: values[rows] for name, values in observations.items() if name != TASK_KEY}
            yield task, own, rows

    def _true(self, task: int, observations: Mapping[str, Tensor]) -> Tensor:
        return state_features(observations, self.specs[task], self.config)

    def _normalizer(self, task: int) -> Normalizer:
        normalizer = self.normalizers[task % len(self.normalizers)]
        assert isinstance(normalizer, Normalizer)
        return normalizer
