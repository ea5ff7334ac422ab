"""The part of a policy that turns a condition into an action chunk."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from torch import Tensor, nn


class ActionHead(nn.Module, ABC):
    """Learns and produces normalised action chunks ``(B, T_p, A)`` from conditions ``(B, C)``."""

    @abstractmethod
    def compute_loss(self, condition: Tensor, chunk: Tensor) -> Tensor:
        """Loss of every entry of the chunks, ``(B, T_p, A)``, in single precision; the caller averages."""

    @abstractmethod
    def sample(self, condition: Tensor, noise: Tensor) -> Tensor:
        """Action chunks ``(B, T_p, A)``, a deterministic function of condition and ``noise`` ``(B, T_p, A)``."""


def squared_error(predicted: Tensor, target: Tensor) -> Tensor:
    """Squared error of every entry, in single precision even if the prediction is not."""
    squared: Tensor = torch.square(predicted.float() - target)
    return squared
