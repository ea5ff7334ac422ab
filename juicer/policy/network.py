"""A whole policy as one network: observations in, absolute action chunks out."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from juicer.episode import ACTION_SIZE
from juicer.policy.actions import action_frame
from juicer.policy.config import PolicyConfig
from juicer.policy.encoder import Encoders, Prepared
from juicer.policy.head import build_head
from juicer.policy.normalizer import Normalizer
from juicer.policy.tasks import Tasks


class PolicyNetwork(nn.Module):
    """Encoders, action frame, normaliser and head.

    Actions are ``(B, T_p, 10)`` and start with the first observed step; ``absolute`` means as recorded,
    ``chunk`` means in the policy's own frame and normalised.
    """

    def __init__(self, config: PolicyConfig, tasks: Tasks) -> None:
        super().__init__()
        self.config = config
        self.tasks = tasks
        self.frame = action_frame(config.action_frame)
        self.encoders = Encoders(config, tasks)
        per_step = config.action_limits == "per_step"
        self.action_normalizer = Normalizer((config.horizons.pred, ACTION_SIZE) if per_step else (ACTION_SIZE,))
        self.head = build_head(config.head, (config.horizons.pred, ACTION_SIZE), self.encoders.sizes)

    @property
    def num_parameters(self) -> int:
        """Number of learned weights."""
        return sum(parameter.numel() for parameter in self.parameters())

    def encode_actions(self, absolute: Tensor, proprioception: Tensor) -> Tensor:
        """Chunks of absolute actions, given the proprioception ``(B, 16)`` of the current step."""
        return self.action_normalizer.normalize(self.frame.encode(absolute, proprioception))

    def decode_actions(self, chunk: Tensor, proprioception: Tensor) -> Tensor:
        """Inverse of :meth:`encode_actions`."""
        return self.frame.decode(self.action_normalizer.denormalize(chunk), proprioception)

    def compute_loss(self, prepared: Prepared, chunk: Tensor) -> Tensor:
        """Loss of every entry ``(B, T_p, 10)``; draws noise from torch's global random state."""
        return self.head.compute_loss(self.encoders(prepared), chunk)

    def act(self, prepared: Prepared, proprioception: Tensor, noise: Tensor) -> Tensor:
        """Absolute actions ``(B, T_p, 10)`` from prepared observations and noise ``(B, T_p, 10)``."""
        return self.decode_actions(self.head.sample(self.encoders(prepared), noise), proprioception)

    def predict(self, observations: Mapping[str, Tensor], noise: Tensor) -> Tensor:
        """Absolute actions ``(B, T_p, 10)`` from raw observations ``(B, T_o, D)``."""
        return self.act(self.encoders.prepare(observations), observations["proprioception"][:, -1], noise)


def build_policy(config: PolicyConfig, tasks: Tasks, seed: int) -> PolicyNetwork:
    """Network whose initial weights depend only on the seed; torch's global random state is left as it was."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return PolicyNetwork(config, tasks)
