"""Proprioception as the condition of a network: scaled, bounded, and not learned."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from torch import Tensor

from juicer.episode import PROPRIOCEPTION_SIZE
from juicer.policy.encoder import PROPRIOCEPTION, ObservationEncoder
from juicer.policy.encoders.proprioception.config import ProprioceptionConfig
from juicer.policy.normalizer import Normalizer
from juicer.policy.tasks import Tasks


class ProprioceptionEncoder(ObservationEncoder):
    """Normalised proprioception, a token an observed step; all tasks of a policy share their limits."""

    observations = (PROPRIOCEPTION,)
    begins_with_proprioception: ClassVar[bool] = True

    def __init__(self, config: ProprioceptionConfig, tasks: Tasks, obs_horizon: int) -> None:
        super().__init__()
        self.clip = config.clip
        self.token_size = (obs_horizon, PROPRIOCEPTION_SIZE)
        self.normalizer = Normalizer((PROPRIOCEPTION_SIZE,))

    def fit(self, observations: Mapping[str, Tensor]) -> None:
        """Take the limits of every number."""
        self.normalizer.fit(observations[PROPRIOCEPTION.name])

    def prepare(self, observations: Mapping[str, Tensor]) -> Tensor:
        """Normalised numbers, bounded so that what was never demonstrated does not blow up the network."""
        return self.normalizer.normalize(observations[PROPRIOCEPTION.name]).clamp(-self.clip, self.clip)

    def forward(self, prepared: Tensor) -> Tensor:
        """The numbers themselves."""
        return prepared
