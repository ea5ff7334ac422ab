"""Images of several views as the condition of a network."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from typing import Self

import torch
from torch import Tensor, nn

from juicer.episode import ArraySpec, Role
from juicer.policy.backbone import Backbone, Pixels, build_backbone, to_shares
from juicer.policy.encoder import ObservationEncoder
from juicer.policy.encoders.images.config import ImagesConfig
from juicer.policy.image_augmentation.network import augmented, centre_crop, random_crop
from juicer.policy.tasks import Tasks


class ImagesEncoder(ObservationEncoder):
    """A token a view and observed step.

    Where the backbone is trained, images stay what they are, uint8 ``(..., h, w, 3)``, until a batch goes through the
    network: a training set of them as numbers would not fit into memory. Where it is frozen, its features are what is
    prepared of them, and in training they are read from a column.
    """

    def __init__(self, config: ImagesConfig, tasks: Tasks, obs_horizon: int) -> None:
        super().__init__()
        self.config = config
        self.views = dict(config.views)
        self.frozen = config.frozen
        self.observations = tuple({view.name: view.observed() for view in self.views.values()}.values())
        self.pixels = Pixels(config.backbone)
        num_backbones = 1 if config.frozen else len(self.views)
        self.backbones = nn.ModuleList(
            build_backbone(config.backbone, config.seen_size(name)) for name in list(self.views)[:num_backbones]
        )
        if config.frozen:
            self.backbones.requires_grad_(False)
        num_features = config.backbone.num_features
        self.projections = nn.ModuleList(
            nn.Linear(num_features, config.projection) if config.projection else nn.Identity() for _ in self.views
        )
        self.token_size = (obs_horizon * len(self.views), config.projection or num_features)

    def fit(self, observations: Mapping[str, Tensor]) -> None:
        """Nothing: every pixel is within its limits."""

    @property
    def training_observations(self) -> tuple[ArraySpec, ...]:
        """The images, or columns of their features."""
        if not self.frozen:
            return self.observations
        names = dict.fromkeys(map(self.config.column, self.views))
        return tuple(ArraySpec(name, (self.config.backbone.num_features,), "float32", Role.DERIVED) for name in names)

    def derive(self, observations: Mapping[str, Tensor]) -> Mapping[str, Tensor]:
        """Features ``(..., C)`` of the views, of a backbone that is frozen."""
        if not self.frozen:
            return {}
        return {
            self.config.column(name): self._features(0, name, observations[view.name])
            for name, view in self.views.items()
        }

    def prepare(self, observations: Mapping[str, Tensor]) -> Mapping[str, Tensor]:
        """By the names of the views the images themselves, or their features ``(..., C)``."""
        if self.frozen:
            return {name: observations[self.config.column(name)] for name in self.views}
        return {name: observations[view.name] for name, view in self.views.items()}

    def forward(self, prepared: Mapping[str, Tensor]) -> Tensor:
        """Tokens ``(B, T_o V, C)`` of what was prepared ``(B, T_o, ...)`` of V views; all views of a step together."""
        tokens = []
        for index, name in enumerate(self.views):
            features = prepared[name] if self.frozen else self._features(index, name, prepared[name])
            tokens.append(self.projections[index](features))
        return torch.stack(tokens, dim=2).flatten(1, 2)

    def train(self, mode: bool = True) -> Self:
        """What is frozen keeps the statistics of its batch normalisation, too."""
        super().train(mode)
        if self.frozen:
            self.backbones.eval()
        return self

    def _backbone(self, index: int) -> Backbone:
        backbone = self.backbones[0 if self.frozen else index]
        assert isinstance(backbone, Backbone)
        return backbone

    def _features(self, index: int, name: str, images: Tensor) -> Tensor:
        """Features ``(..., C)`` of images ``(..., h, w, 3)`` of a view."""
        samples = images if images.ndim == 5 else images.unsqueeze(1)
        shown = brightness(samples, self.config, name, is_training=self.training and not self.frozen)
        with torch.no_grad() if self.frozen else nullcontext():
            features: Tensor = self._backbone(index)(self.pixels(shown))
        return features.reshape(*images.shape[:-3], -1)


def brightness(images: Tensor, config: ImagesConfig, name: str, is_training: bool) -> Tensor:
    """What the backbone is shown of images: shares of full brightness.

    Args:
        images: Of one view, ``(B, T, h, w, 3)`` uint8.
        config: What the encoder was built of.
        name: Name of the view in it.
        is_training: Whether they are cropped and varied at random, from torch's random state, one draw a sample.

    Returns:
        ``(B T, 3, H, W)``, laid out in memory as convolutions like it best.
    """
    if name in config.crops:
        images = (random_crop if is_training else centre_crop)(images, config.seen_size(name))
    if is_training and config.augmentation is not None:
        varied = augmented(images, config.augmentation).flatten(0, 1)
        return varied.contiguous(memory_format=torch.channels_last)
    return to_shares(images.flatten(0, 1))
