"""The processes that train one policy together, each on its part of every batch: one, or several of ``torchrun``.

They hold the same weights, and a step is the one that a single process would take with the whole batch, to rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, distributed, nn
from torch.nn.modules.batchnorm import _BatchNorm
from torch.nn.parallel import DistributedDataParallel

from juicer.errors import ConfigError
from juicer.policy.backbone import BatchNorm
from juicer.policy.draws import Part
from juicer.policy.torch_settings import usable_device


@dataclass(frozen=True)
class Ranks:
    """This process among those that train one policy together.

    Attributes:
        number: Its number, from 0.
        count: How many there are.
    """

    number: int = 0
    count: int = 1

    @property
    def leads(self) -> bool:
        """Whether it is the one that reports, validates, and writes what is kept."""
        return self.number == 0

    def part(self, batch_size: int) -> Part | None:
        """Which samples of every batch are this process's; None if all are.

        Raises:
            ConfigError: If there are fewer samples than processes.
        """
        if self.count == 1:
            return None
        if batch_size < self.count:
            raise ConfigError(
                f"a batch of {batch_size} (training.batch_size) cannot be shared by {self.count} processes; raise it, "
                "or lower JUICER_TRAIN_PROCESSES"
            )
        first, end = (number * batch_size // self.count for number in (self.number, self.number + 1))
        return Part(first, end - first, batch_size)

    def total(self, own: Tensor) -> Tensor:
        """Sum over all processes of a tensor that each has."""
        if self.count == 1:
            return own
        total = own.detach().clone()
        distributed.all_reduce(total)
        return total

    def join(self, loss: nn.Module, device: torch.device, images: int) -> nn.Module:
        """The module, with gradients that are means over all processes.

        Args:
            loss: What learns.
            device: What it computes on.
            images: How many images of each view the whole batch has.

        Raises:
            ConfigError: See :func:`share_statistics`.
        """
        if self.count == 1:
            return loss
        share_statistics(loss, device, images)
        return DistributedDataParallel(
            loss,
            device_ids=[device] if device.type == "cuda" else None,
            forward_sync_buffers=False,
            gradient_as_bucket_view=True,
        )


def share_statistics(network: nn.Module, device: torch.device, images: int) -> None:
    """Have batch normalisation take the statistics of the whole batch, of which this process sees a part.

    What takes none, of so small a batch or as it is frozen, stays as it is: of a part it takes none either.

    Args:
        network: What is changed.
        device: What it computes on.
        images: How many images the whole batch has.

    Raises:
        ConfigError: If there is no GPU: torch shares statistics on these only.
    """
    for name, layer in list(network.named_modules()):
        if not isinstance(layer, _BatchNorm) or not layer.training:
            continue
        if isinstance(layer, BatchNorm) and not layer.takes_statistics(images):
            continue
        if device.type != "cuda":
            raise ConfigError(
                "batch normalisation needs the whole batch, which several processes share on GPUs only; set "
                "JUICER_TRAIN_PROCESSES=1, or choose an encoder with GroupNorm"
            )
        network.set_submodule(name, nn.SyncBatchNorm.convert_sync_batchnorm(layer))  # type: ignore[no-untyped-call]


def current_ranks() -> Ranks:
    """Those of the default process group; this process alone if there is none."""
    if not (distributed.is_available() and distributed.is_initialized()):
        return Ranks()
    return Ranks(distributed.get_rank(), distributed.get_world_size())


@contextmanager
def joined(ranks: Ranks, device: str, meeting: Path) -> Iterator[None]:
    """Be one of several processes on this machine for the length of a block.

    Args:
        ranks: Which one.
        device: What it computes on.
        meeting: File, not there yet, through which they find each other.

    Raises:
        ConfigError: If this machine does not have the device.
    """
    is_gpu = usable_device(device).type == "cuda"
    if is_gpu:
        torch.cuda.set_device(device)
    distributed.init_process_group(
        "nccl" if is_gpu else "gloo",
        init_method=meeting.as_uri(),
        rank=ranks.number,
        world_size=ranks.count,
    )
    yield
    # Not after an error: it waits for the others, which may have ended already.
    distributed.destroy_process_group()
