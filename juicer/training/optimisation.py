"""How gradients become weights: AdamW, the rise and fall of its rate, and a moving average of the weights."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Generic, NamedTuple, TypeVar

import torch
from torch import Tensor, nn

from juicer.errors import TrainingFailed

AVERAGED_EVERY = 4
"""Steps between updates of the moving average, which touches every weight and would cost a twelfth of each step."""
MOMENTS = ("exp_avg", "exp_avg_sq")
"""What AdamW remembers of each parameter, by its own names."""

Network = TypeVar("Network", bound=nn.Module)


class Schedule(NamedTuple):
    """Learning rates: a linear warm-up, then a cosine that ends at zero.

    Attributes:
        peak: The largest.
        warmup_steps: Steps until then.
        steps: Of the whole training.
    """

    peak: float
    warmup_steps: int
    steps: int

    def rate(self, step: int) -> float:
        """Rate of a step, counted from 0."""
        if step < self.warmup_steps:
            return self.peak * (step + 1) / self.warmup_steps
        done = (step - self.warmup_steps) / (self.steps - self.warmup_steps)
        return self.peak * 0.5 * (1 + math.cos(math.pi * done))


class Optimisation(Generic[Network]):
    """Changes a network's weights by their gradients.

    Attributes:
        network: The network that learns.
        average: Moving average of its weights, if one is kept.
        parameters: What is learned of it.
        schedule: Of the learning rate.
    """

    def __init__(
        self, network: Network, schedule: Schedule, *, weight_decay: float, average_decay: float | None
    ) -> None:
        self.network = network.train()
        self.average = copy.deepcopy(network).requires_grad_(False).eval() if average_decay else None
        self.parameters = [each for each in network.parameters() if each.requires_grad]
        self.schedule = schedule
        self._average_decay = average_decay
        self._optimizer = torch.optim.AdamW(self.parameters, lr=schedule.peak, weight_decay=weight_decay, fused=True)

    @property
    def acting(self) -> Network:
        """The network that would act: the moving average, if one is kept."""
        return self.network if self.average is None else self.average

    def forget_gradients(self) -> None:
        """Free them, before others are computed."""
        self._optimizer.zero_grad(set_to_none=True)

    def step(self, step: int) -> None:
        """Change the weights by the gradients that they have.

        Args:
            step: Its number, from 0.
        """
        for parameter in self.parameters:
            # The fused AdamW pairs numbers of weights and gradients as they lie in memory, and looks at no strides.
            if parameter.grad is not None and parameter.grad.stride() != parameter.stride():
                parameter.grad = torch.empty_like(parameter).copy_(parameter.grad)
        self._optimizer.param_groups[0]["lr"] = self.schedule.rate(step)
        self._optimizer.step()
        self._update_average(step)

    def tensors(self) -> dict[str, Tensor]:
        """Everything that a later :meth:`step` depends on, by name; of the usual memory format."""
        tensors = {f"network.{name}": value for name, value in self.network.state_dict().items()}
        if self.average is not None:
            tensors |= {f"ema.{name}": value for name, value in self.average.state_dict().items()}
        for index, parameter in enumerate(self.parameters):
            tensors |= {f"{moment}.{index}": self._optimizer.state[parameter][moment] for moment in MOMENTS}
        return {name: value.contiguous() for name, value in tensors.items()}

    @torch.no_grad()
    def restore(self, tensors: Mapping[str, Tensor], step: int) -> None:
        """Continue where :meth:`tensors` were taken after ``step`` steps."""
        self.network.load_state_dict(_below("network.", tensors))
        if self.average is not None:
            self.average.load_state_dict(_below("ema.", tensors))
        state = self._optimizer.state_dict()
        state["state"] = {
            index: {
                "step": torch.tensor(float(step)),
                **{name: torch.empty_like(parameter).copy_(tensors[f"{name}.{index}"]) for name in MOMENTS},
            }
            for index, parameter in enumerate(self.parameters)
        }
        self._optimizer.load_state_dict(state)

    @torch.no_grad()
    def _update_average(self, step: int) -> None:
        if self.average is None or self._average_decay is None or (step + 1) % AVERAGED_EVERY:
            return
        # Early on a long memory would mostly remember the initial weights.
        decay = min(self._average_decay, (1 + step) / (10 + step)) ** AVERAGED_EVERY
        both = zip(self.average.parameters(), self.network.parameters(), strict=True)
        averages, current = zip(*((average, own) for average, own in both if own.requires_grad), strict=True)
        torch._foreach_lerp_(averages, current, 1 - decay)
        # Statistics of batch normalisation are averages already.
        for average, own in zip(self.average.buffers(), self.network.buffers(), strict=True):
            average.copy_(own)


def require_number(loss: float, step: int, remedy: str) -> None:
    """Stop a training whose loss is no longer a number.

    Raises:
        TrainingFailed: With the remedy.
    """
    if not math.isfinite(loss):
        raise TrainingFailed(f"the loss is no longer a number by step {step}; {remedy}")


def _below(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
