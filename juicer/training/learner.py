"""One network and what makes it learn: optimiser, schedule, precision, moving average."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import cast

import torch
from torch import Tensor, nn

from juicer.errors import ConfigError
from juicer.policy.draws import drawing_for
from juicer.policy.encoder import Prepared
from juicer.policy.network import PolicyNetwork
from juicer.policy.torch_settings import has_fast_bfloat16
from juicer.seeding import stream
from juicer.text import printable
from juicer.training.config import TrainingConfig
from juicer.training.ranks import Ranks
from juicer.training.source import Batch

AVERAGED_EVERY = 4
"""Steps between updates of the moving average, which touches every weight and would cost a twelfth of each step."""
MOMENTS = ("exp_avg", "exp_avg_sq")
"""What AdamW remembers of each parameter, by its own names."""


def learning_rate(step: int, config: TrainingConfig) -> float:
    """Rate of a step, counted from 0: linear warm-up, then a cosine that ends at zero."""
    if step < config.warmup_steps:
        return config.learning_rate * (step + 1) / config.warmup_steps
    done = (step - config.warmup_steps) / (config.steps - config.warmup_steps)
    return config.learning_rate * 0.5 * (1 + math.cos(math.pi * done))


def torch_seed(seed: int, *names: str | int) -> int:
    """Seed for torch's random state, one for each purpose; see :func:`juicer.seeding.stream`."""
    return int(stream(seed, *names).integers(2**63))


class _Loss(nn.Module):
    """The loss of a network as a module's call, which is what torch compiles and shares among processes."""

    def __init__(self, network: PolicyNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, prepared: Prepared, chunk: Tensor) -> Tensor:
        """See :meth:`PolicyNetwork.compute_loss`."""
        return self.network.compute_loss(prepared, chunk)


class Learner:
    """Takes training steps; what is random in them comes from torch's global random state.

    Attributes:
        network: The network that learns.
        ema: Moving average of its weights, if one is kept.
        precision: Arithmetic it computes with, ``bf16`` or ``fp32``; chosen by the processor if the config leaves it.
    """

    def __init__(
        self, network: PolicyNetwork, config: TrainingConfig, device: torch.device, ranks: Ranks | None = None
    ) -> None:
        if config.memory_format == "channels_last":
            network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.network = network.train()
        self.ema = copy.deepcopy(network).requires_grad_(False).eval() if config.ema_decay else None
        self._config = config
        self._device = device
        self._ranks = ranks or Ranks()
        self._part = self._ranks.part(config.batch_size)
        self.precision = config.precision
        if config.precision == "auto":
            self.precision = "bf16" if device.type != "cpu" or has_fast_bfloat16() else "fp32"
        self._parameters = [each for each in network.parameters() if each.requires_grad]
        self._optimizer = torch.optim.AdamW(
            self._parameters, lr=config.learning_rate, weight_decay=config.weight_decay, fused=True
        )
        self._loss = self._ranks.join(_Loss(network), device, config.batch_size * network.config.horizons.obs)
        if config.compile:
            self._loss.compile()

    @property
    def acting(self) -> PolicyNetwork:
        """The network that would act: the moving average, if one is kept."""
        return self.network if self.ema is None else self.ema

    def learn(self, batch: Batch, step: int) -> Tensor:
        """Take one training step and return its loss, a scalar.

        Args:
            batch: This process's part of the step's batch.
            step: Its number, from 0.

        Raises:
            ConfigError: If torch cannot compile the network here.
        """
        targets = self._ranks.total(batch.weight.sum())
        with _compiler_named(), drawing_for(self._part):
            with torch.autocast(self._device.type, torch.bfloat16, enabled=self.precision == "bf16"):
                losses = cast(Tensor, self._loss(batch.prepared, batch.chunk))
            loss = batch.average(losses, targets)
            self._optimizer.zero_grad(set_to_none=True)
            # Gradients are averaged over the processes, and are to be summed.
            (loss * self._ranks.count).backward()  # type: ignore[no-untyped-call]
        self._optimizer.param_groups[0]["lr"] = learning_rate(step, self._config)
        self._optimizer.step()
        self._average(step)
        return self._ranks.total(loss.detach())

    def tensors(self) -> dict[str, Tensor]:
        """Everything that a later :meth:`learn` depends on, by name; of the usual memory format."""
        tensors = {f"network.{name}": value for name, value in self.network.state_dict().items()}
        if self.ema is not None:
            tensors |= {f"ema.{name}": value for name, value in self.ema.state_dict().items()}
        for index, parameter in enumerate(self._parameters):
            tensors |= {f"{moment}.{index}": self._optimizer.state[parameter][moment] for moment in MOMENTS}
        return {name: value.contiguous() for name, value in tensors.items()}

    @torch.no_grad()
    def restore(self, tensors: Mapping[str, Tensor], step: int) -> None:
        """Continue where :meth:`tensors` were taken after ``step`` steps."""
        self.network.load_state_dict(_below("network.", tensors))
        if self.ema is not None:
            self.ema.load_state_dict(_below("ema.", tensors))
        state = self._optimizer.state_dict()
        state["state"] = {
            index: {
                "step": torch.tensor(float(step)),
                **{name: torch.empty_like(parameter).copy_(tensors[f"{name}.{index}"]) for name in MOMENTS},
            }
            for index, parameter in enumerate(self._parameters)
        }
        self._optimizer.load_state_dict(state)

    @torch.no_grad()
    def _average(self, step: int) -> None:
        if self.ema is None or self._config.ema_decay is None or (step + 1) % AVERAGED_EVERY:
            return
        # Early on a long memory would mostly remember the initial weights.
        decay = min(self._config.ema_decay, (1 + step) / (10 + step)) ** AVERAGED_EVERY
        both = zip(self.ema.parameters(), self.network.parameters(), strict=True)
        averages, current = zip(*((average, own) for average, own in both if own.requires_grad), strict=True)
        torch._foreach_lerp_(averages, current, 1 - decay)
        # Statistics of batch normalisation are averages already.
        for average, own in zip(self.ema.buffers(), self.network.buffers(), strict=True):
            average.copy_(own)


def _below(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}


@contextmanager
def _compiler_named() -> Iterator[None]:
    """Have torch's long report of a failed compilation replaced by a sentence."""
    try:
        yield
    except Exception as error:
        if not type(error).__module__.startswith(("torch._dynamo", "torch._inductor")):
            raise
        reason = str(error).strip().partition("\n")[0]
        raise ConfigError(
            f"torch cannot compile the network on this machine ({printable(reason)}); set training.compile to false, "
            "or install what it asks for: a C++ compiler for processors, Triton for GPUs"
        ) from error
