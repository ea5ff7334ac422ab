"""Batches for the steps of a training, gathered in its own process, or ahead of time in processes beside it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from juicer.errors import JuicerError, TrainingFailed
from juicer.policy.draws import Part
from juicer.training.config import StateNoise
from juicer.training.learner import torch_seed
from juicer.training.source import Batch, BatchOrder, WindowSource

Gathered = tuple[Batch, Tensor]
"""A batch, and torch's random state after it was gathered."""


@dataclass(frozen=True)
class Feed(Dataset[Gathered | JuicerError]):
    """The batch of each step, a function of the seed and the step alone.

    Attributes:
        source: Where windows come from.
        order: Which windows a step learns from.
        noise: What observed states are perturbed by.
        seed: Root of all that is random in a step.
        part: Which samples of every batch are wanted; all if None.
    """

    source: WindowSource
    order: BatchOrder
    noise: StateNoise | None
    seed: int
    part: Part | None = None

    def batches(self, first: int, end: int, loaders: int, device: torch.device) -> Iterator[Batch]:
        """Batches of steps on a device; with each, torch's global random state is that of its step.

        Args:
            first: Step of the first batch.
            end: Step before which they end.
            loaders: Processes that gather them ahead of time; results are the same with any number.
            device: Where to.

        Raises:
            TrainingFailed: If such a process dies.
        """
        if not loaders:
            for step in range(first, end):
                yield self.gather(step).to(device)
            return
        for step, (batch, random_state) in enumerate(self._loaded(first, end, loaders, device), first):
            moved = batch.to(device)
            self._seed(step)
            torch.set_rng_state(random_state)
            yield moved

    def gather(self, step: int) -> Batch:
        """The batch of a step, where its source keeps windows; leaves torch's random state to the rest of the step."""
        self._seed(step)
        rows = self.order.rows(step)
        if self.part is None:
            return self.source.gather(rows, self.noise)
        if self.noise is None:
            return self.source.gather(rows[self.part.rows])
        # Which samples are perturbed, and how, is a matter of the whole batch.
        return self.source.gather(rows, self.noise).take(self.part.rows)

    def __getitem__(self, step: int) -> Gathered | JuicerError:
        """What a process beside the training gathers. Raised there, an error would arrive as a long text."""
        try:
            return self.gather(step), torch.get_rng_state()
        except JuicerError as error:
            return error

    def _seed(self, step: int) -> None:
        torch.manual_seed(torch_seed(self.seed, "step", step))

    def _loaded(self, first: int, end: int, loaders: int, device: torch.device) -> Iterator[Gathered]:
        loader = DataLoader(
            self,
            batch_size=None,
            sampler=range(first, end),
            num_workers=loaders,
            pin_memory=device.type == "cuda",
            # Windows are inherited, not sent.
            multiprocessing_context="fork",
        )
        batches = iter(loader)
        # They are counted: nothing depends on how the processes end once the last batch is here.
        for _ in range(first, end):
            try:
                gathered = next(batches)
            except RuntimeError as error:
                if "DataLoader worker" not in str(error):
                    raise
                raise TrainingFailed(
                    "a process that gathers batches has died, perhaps for want of memory or of room in /dev/shm; "
                    "lower JUICER_LOADERS, or set it to 0"
                ) from None
            if isinstance(gathered, JuicerError):
                raise gathered
            yield gathered
