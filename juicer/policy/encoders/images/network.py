"""Images of several views as the condition of a network."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from typing import Self

import torch
from torch import Tensor, nn

from juicer.policy.backbone import Backbone, Pixels, build_backbone
from juicer.policy.encoder import ObservationEncoder
from juicer.policy.encoders.images.config import ImagesConfig
from juicer.policy.tasks import Tasks
from juicer.views import View

FULL_BRIGHTNESS = 255


class ImagesEncoder(ObservationEncoder):
    """A token a view and observed step.

    Images stay what they are, uint8 ``(..., h, w, 3)``, until a batch goes through the network: a training set of
    them as numbers would not fit into memory.
    """

    def __init__(self, config: ImagesConfig, tasks: Tasks, obs_horizon: int) -> None:
        super().__init__()
        self.views = dict(config.views)
        self.frozen = config.frozen
        self.observations = tuple({view.name: view.observed() for view in self.views.values()}.values())
        self.pixels = Pixels(config.backbone)
        num_backbones = 1 if config.frozen else len(self.views)
        self.backbones = nn.ModuleList(
            build_backbone(config.backbone, (view.height, view.width))
            for view in list(self.views.values())[:num_backbones]
        )
        if config.frozen:
            self.backbones.requires_grad_(False)
        num_features = self._backbone(0).num_features
        self.projections = nn.ModuleList(
            nn.Linear(num_features, config.projection) if config.projection else nn.Identity() for _ in self.views
        )
        self.token_size = (obs_horizon * len(self.views), config.projection or num_features)

    def fit(self, observations: Mapping[str, Tensor]) -> None:
        """Nothing: every pixel is within its limits."""

    def prepare(self, observations: Mapping[str, Tensor]) -> Mapping[str, Tensor]:
        """The images themselves, by the names of their views."""
        return {name: observations[view.name] for name, view in self.views.items()}

    def forward(self, prepared: Mapping[str, Tensor]) -> Tensor:
        """Tokens ``(B, T_o V, C)`` of images ``(B, T_o, h, w, 3)`` of V views; all views of a step side by side."""
        tokens = [self._tokens(index, prepared[name]) for index, name, _ in self._items()]
        return torch.stack(tokens, dim=2).flatten(1, 2)

    def train(self, mode: bool = True) -> Self:
        """What is frozen keeps the statistics of its batch normalisation, too."""
        super().train(mode)
        if self.frozen:
            self.backbones.eval()
        return self

    def _items(self) -> Iterator[tuple[int, str, View]]:
        return ((index, name, view) for index, (name, view) in enumerate(self.views.items()))

    def _backbone(self, index: int) -> Backbone:
        backbone = self.backbones[0 if self.frozen else index]
        assert isinstance(backbone, Backbone)
        return backbone

    def _tokens(self, index: int, images: Tensor) -> Tensor:
        # As they lie in memory, images are what convolutions call channels last, and the fastest on most hardware.
        pixels = images.flatten(0, 1).permute(0, 3, 1, 2).float() / FULL_BRIGHTNESS
        with torch.no_grad() if self.frozen else nullcontext():
            features = self._backbone(index)(self.pixels(pixels))
        tokens: Tensor = self.projections[index](features)
        return tokens.reshape(*images.shape[:2], -1)
