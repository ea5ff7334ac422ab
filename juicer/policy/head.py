"""The part of a policy that turns a condition into an action chunk."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from torch import Tensor, nn

from juicer.policy.condition import Condition, ConditionSizes
from juicer.policy.members import HeadConfig

ChunkShape = tuple[int, int]
"""Actions of a chunk T_p and numbers of an action A."""


class ActionHead(nn.Module, ABC):
    """Learns and produces normalised action chunks ``(B, T_p, A)`` from conditions.

    It is built with its configuration, the shape of a chunk, and the sizes of a condition.
    """

    @abstractmethod
    def compute_loss(self, condition: Condition, chunk: Tensor) -> Tensor:
        """Loss of every entry of the chunks, ``(B, T_p, A)``, in single precision; the caller averages."""

    @abstractmethod
    def sample(self, condition: Condition, noise: Tensor) -> Tensor:
        """Action chunks ``(B, T_p, A)``, a deterministic function of condition and ``noise`` ``(B, T_p, A)``."""


def build_head(config: HeadConfig, chunk: ChunkShape, condition: ConditionSizes) -> ActionHead:
    """The head of a configuration."""
    head: ActionHead = config.network_class()(config, chunk, condition)
    return head


def squared_error(predicted: Tensor, target: Tensor) -> Tensor:
    """Squared error of every entry, in single precision even if the prediction is not."""
    squared: Tensor = torch.square(predicted.float() - target)
    return squared
