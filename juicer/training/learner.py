"""One network and what makes it learn: optimiser, schedule, precision, moving average."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import cast

import torch
from torch import Tensor, nn

from juicer.errors import ConfigError
from juicer.policy.draws import drawing_for
from juicer.policy.encoder import Prepared
from juicer.policy.network import PolicyNetwork
from juicer.policy.torch_settings import chosen_precision
from juicer.seeding import stream
from juicer.text import printable
from juicer.training.config import TrainingConfig
from juicer.training.optimisation import Optimisation, Schedule
from juicer.training.ranks import Ranks
from juicer.training.source import Batch


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
        schedule: Of the learning rate.
        precision: Arithmetic it computes with, ``bf16`` or ``fp32``; chosen by the processor if the config leaves it.
    """

    def __init__(
        self, network: PolicyNetwork, config: TrainingConfig, device: torch.device, ranks: Ranks | None = None
    ) -> None:
        if config.memory_format == "channels_last":
            network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.schedule = Schedule(config.learning_rate, config.warmup_steps, config.steps)
        self._optimisation = Optimisation(
            network, self.schedule, weight_decay=config.weight_decay, average_decay=config.ema_decay
        )
        self.network, self.ema = network, self._optimisation.average
        self._device = device
        self._ranks = ranks or Ranks()
        self._part = self._ranks.part(config.batch_size)
        self.precision = chosen_precision(config.precision, device)
        self._loss = self._ranks.join(_Loss(network), device, config.batch_size * network.config.horizons.obs)
        if config.compile:
            self._loss.compile()

    @property
    def acting(self) -> PolicyNetwork:
        """The network that would act: the moving average, if one is kept."""
        return self._optimisation.acting

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
            self._optimisation.forget_gradients()
            # Gradients are averaged over the processes, and are to be summed.
            (loss * self._ranks.count).backward()  # type: ignore[no-untyped-call]
        self._optimisation.step(step)
        return self._ranks.total(loss.detach())

    def tensors(self) -> dict[str, Tensor]:
        """Everything that a later :meth:`learn` depends on, by name; of the usual memory format."""
        return self._optimisation.tensors()

    def restore(self, tensors: Mapping[str, Tensor], step: int) -> None:
        """Continue where :meth:`tensors` were taken after ``step`` steps."""
        self._optimisation.restore(tensors, step)


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
