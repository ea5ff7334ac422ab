"""The estimator: features of a state from images and proprioception."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn import functional

from juicer.episode import PROPRIOCEPTION_SIZE
from juicer.policy.backbone import Pixels, build_backbone, to_shares
from juicer.policy.config import FeatureSpec
from juicer.policy.encoders.estimated.config import EstimatedConfig
from juicer.policy.encoders.features.features import num_choices, num_features
from juicer.policy.normalizer import Normalizer

READ = (*range(9), 15)
"""What is taken from the proprioception: position, rotation and opening of the gripper. Velocities would tell how far a
demonstration has come, and not where a part is."""

BETA = 0.05
"""Normalised error from which on the loss grows linearly: a part that cannot be seen must not outweigh all others."""
CHOICE_WEIGHT = 0.05
"""Of the loss of the pair that is next, beside that of the features."""


class Estimator(nn.Module):
    """Features of one task's state as :func:`state_features` computes them from true poses, read off images.

    Which pair is to be mounted next is decided first, and then where its parts are: a blend of two pairs' features, as
    a regression would yield where it is in doubt, describes no state at all.

    Attributes:
        config: What it sees and is made of.
        task: Name of the assembly task whose parts it finds.
        spec: The task's numbers.
        normalizer: Limits of the features that it has learned from.
    """

    def __init__(self, config: EstimatedConfig, task: str, spec: FeatureSpec) -> None:
        super().__init__()
        self.config, self.task, self.spec = config, task, spec
        estimator, size = config.estimator, num_features(spec, config.features)
        self.normalizer = Normalizer((size,))
        self.num_choices = num_choices(spec, config.features)
        self.pixels = Pixels(estimator.backbone)
        backbones = [build_backbone(estimator.backbone, (v.height, v.width)) for v in estimator.views.values()]
        self.backbones = nn.ModuleList(backbones)
        width, half = estimator.width, estimator.width // 2
        seen = len(READ) + len(backbones) * estimator.backbone.num_features
        self.together = nn.Sequential(nn.Linear(seen, width), nn.ReLU())
        self.choice = nn.Linear(width, self.num_choices)
        self.head = nn.Sequential(
            nn.Linear(width + self.num_choices, half),
            nn.ReLU(),
            nn.Linear(half, size - PROPRIOCEPTION_SIZE - self.num_choices + 1),
        )
        # Before them stands the proprioception, which is known, and behind them which pair is next.
        self._shown = slice(PROPRIOCEPTION_SIZE, size - self.num_choices + 1)

    def is_like(self, other: Estimator) -> bool:
        """Whether another one estimates the same of the same task from the same."""
        return (self.config, self.task, self.spec) == (other.config, other.task, other.spec)

    def forward(self, observations: Mapping[str, Tensor]) -> Tensor:
        """Features ``(..., F)`` of proprioception ``(..., 16)`` and the views' images ``(..., h, w, 3)`` of uint8."""
        proprioception = observations["proprioception"]
        leading = proprioception.shape[:-1]
        images = [
            observations[view.name].reshape(-1, view.height, view.width, 3)
            for view in self.config.estimator.views.values()
        ]
        rows = proprioception.reshape(-1, PROPRIOCEPTION_SIZE)
        return self.features(self.see(images, rows), rows).reshape(*leading, -1)

    def see(self, images: list[Tensor], proprioception: Tensor) -> Tensor:
        """What is seen ``(B, width)`` in images ``(B, h, w, 3)`` a view, with the proprioception ``(B, 16)``."""
        offset, scale = self.normalizer.offset[:PROPRIOCEPTION_SIZE], self.normalizer.scale[:PROPRIOCEPTION_SIZE]
        read = ((proprioception - offset) / scale)[:, READ]
        found = [
            backbone(self.pixels(to_shares(image))) for backbone, image in zip(self.backbones, images, strict=True)
        ]
        together: Tensor = self.together(torch.cat([*found, read], dim=-1))
        return together

    def features(self, seen: Tensor, proprioception: Tensor) -> Tensor:
        """Features ``(B, F)`` of what is seen."""
        chosen = functional.one_hot(self.choice(seen).argmax(dim=-1), self.num_choices)
        predicted = self.head(torch.cat([seen, chosen], dim=-1)).float()
        features = predicted * self.normalizer.scale[self._shown] + self.normalizer.offset[self._shown]
        return torch.cat([proprioception, features, chosen[:, 1:]], dim=-1)

    def compute_loss(self, seen: Tensor, features: Tensor) -> Tensor:
        """Loss, a scalar, of what is seen, by the true features ``(B, F)``."""
        true = self.normalizer.normalize(features)[:, self._shown]
        chosen = _choice_of(features[:, self._shown.stop :])
        predicted = self.head(torch.cat([seen, functional.one_hot(chosen, self.num_choices)], dim=-1))
        loss = functional.smooth_l1_loss(predicted.float(), true, beta=BETA)
        return loss + CHOICE_WEIGHT * functional.cross_entropy(self.choice(seen).float(), chosen)


def build_estimator(config: EstimatedConfig, task: str, spec: FeatureSpec, seed: int) -> Estimator:
    """Estimator whose initial weights depend only on the seed; torch's global random state is left as it was."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return Estimator(config, task, spec)


def _choice_of(which: Tensor) -> Tensor:
    """Which pair is next ``(B,)``, of one number ``(B, K - 1)`` for each but the first."""
    first = 1 - which.sum(dim=-1, keepdim=True)
    return torch.cat([first, which], dim=-1).argmax(dim=-1)
