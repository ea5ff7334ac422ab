"""Features of a state as the condition of a network, estimated from images when it acts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Self

from torch import Tensor, nn

from juicer.episode import SIMULATOR, ArraySpec
from juicer.errors import ConfigError
from juicer.policy.encoder import ObservationEncoder
from juicer.policy.encoders.estimated.config import EstimatedConfig
from juicer.policy.encoders.estimated.estimator import Estimator
from juicer.policy.encoders.estimated.files import load_estimator
from juicer.policy.encoders.features.network import FeatureEncoder
from juicer.policy.tasks import Tasks


class EstimatedEncoder(ObservationEncoder):
    """State features: true ones in training, those that an estimator reads off images when the policy acts.

    Every task has an estimator of its own. They have learned before and are never changed: the optimiser does not know
    them, and they travel with the weights.
    """

    begins_with_proprioception: ClassVar[bool] = True

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
        """Proprioception and true poses; no image."""
        return self.features.observations

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

    def fit(self, observations: Mapping[str, Tensor]) -> None:
        """Take the limits of every true feature."""
        self.features.fit(observations)

    def prepare(self, observations: Mapping[str, Tensor]) -> Tensor:
        """Normalised, bounded features as the estimators of the tasks read them off images."""
        return self.features.scaled(observations, lambda task, own: self.estimators[task](own))

    def prepare_training(self, observations: Mapping[str, Tensor]) -> Tensor:
        """The same features as they truly are."""
        return self.features.prepare(observations)

    def forward(self, prepared: Tensor) -> Tensor:
        """The features themselves."""
        return prepared
