"""Features of a state as the condition of a network, estimated from images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Self

import torch
from torch import Tensor, nn
from torch.nn import functional

from juicer.episode import PROPRIOCEPTION_SIZE, SIMULATOR, ArraySpec, Role
from juicer.errors import ConfigError
from juicer.policy.encoder import ObservationEncoder
from juicer.policy.encoders.estimated.config import EstimatedConfig
from juicer.policy.encoders.estimated.estimator import Estimator
from juicer.policy.encoders.estimated.files import load_estimator
from juicer.policy.encoders.features.network import FeatureEncoder
from juicer.policy.tasks import Tasks


class EstimatedEncoder(ObservationEncoder):
    """State features as an estimator reads them off images, in training as when the policy acts.

    So a policy learns to act on what it will see, errors of the estimator included. Were it shown true features, and
    later actions that came of estimated ones, it would learn the estimator's errors and add them to those of the next
    estimate.

    Every task has an estimator of its own. They have learned before and are never changed: the optimiser does not know
    them, and they travel with the weights.
    """

    begins_with_proprioception: ClassVar[bool] = True
    is_taught_poses: ClassVar[bool] = True

    def __init__(self, config: EstimatedConfig, tasks: Tasks, obs_horizon: int) -> None:
        super().__init__()
        self.config = config
        self.tasks = tuple(tasks)
        self.features = FeatureEncoder(config.features, tasks, obs_horizon)
        self.estimators = nn.ModuleList(Estimator(config, *each) for each in tasks.items()).requires_grad_(False)
        self.token_size = self.features.token_size
        images = (view.observed() for view in config.estimator.views.values())
        self.observations = (SIMULATOR["proprioception"], *images)

    @property
    def training_observations(self) -> tuple[ArraySpec, ...]:
        """Proprioception, and a column of what else the features tell."""
        size = self.features.token_size[1] - PROPRIOCEPTION_SIZE
        return (SIMULATOR["proprioception"], ArraySpec(self.config.column, (size,), "float32", Role.DERIVED))

    def take_estimators(self, folders: Sequence[Path]) -> None:
        """Take the estimator of every task; see :class:`juicer.policy.encoder.ObservationEncoder`."""
        given = [load_estimator(folder) for folder in dict.fromkeys(folders)]
        for task, place in zip(self.tasks, self.estimators, strict=True):
            assert isinstance(place, Estimator)
            found = [each for each in given if each.is_like(place)]
            if not found:
                raise ConfigError(
                    f"the policy estimates the poses of {task} from images, and no estimator of this configuration and "
                    "task was given; make one by the stage 'estimate', or run the whole loop"
                )
            if len(found) > 1:
                raise ConfigError(
                    f"{len(found)} estimators of this configuration were given for {task}, and only one can tell the "
                    "policy where parts are; give one for each task"
                )
            place.load_state_dict(found[0].state_dict())

    def train(self, mode: bool = True) -> Self:
        """Estimators learn nothing more, and keep the statistics of a batch normalisation."""
        super().train(mode)
        self.estimators.eval()
        return self

    def derive(self, observations: Mapping[str, Tensor]) -> Mapping[str, Tensor]:
        """Estimates ``(..., F - 16)``: features without the proprioception; zero behind those that a task has."""
        proprioception = observations["proprioception"]
        size = self.features.token_size[1] - PROPRIOCEPTION_SIZE
        estimates = proprioception.new_zeros(*proprioception.shape[:-1], size)
        for task, own, rows in self.features.by_task(observations):
            found = self.estimators[task](own)[..., PROPRIOCEPTION_SIZE:]
            estimates[rows] = functional.pad(found, (0, size - found.shape[-1]))
        return {self.config.column: estimates}

    def fit(self, observations: Mapping[str, Tensor]) -> None:
        """Take the limits of every feature, as estimated."""
        self.features.fit_to(observations, self._estimated)

    def prepare(self, observations: Mapping[str, Tensor]) -> Tensor:
        """Normalised, bounded features of what was estimated."""
        return self.features.scaled(observations, self._estimated)

    def forward(self, prepared: Tensor) -> Tensor:
        """The features themselves."""
        return prepared

    def _estimated(self, task: int, observations: Mapping[str, Tensor]) -> Tensor:
        size = self.features.lengths[task] - PROPRIOCEPTION_SIZE
        return torch.cat([observations["proprioception"], observations[self.config.column][..., :size]], dim=-1)
