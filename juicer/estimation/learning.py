"""How an estimator learns from drawn states, and how far off it is where precision decides."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from juicer.episode import PROPRIOCEPTION_SIZE
from juicer.estimation.drawn import DrawnStates
from juicer.policy.backbone import BatchNorm
from juicer.policy.config import FeatureSpec
from juicer.policy.encoders.estimated.estimator import Estimator
from juicer.policy.encoders.features.features import read_pair, state_features
from juicer.policy.torch_settings import chosen_precision, compute_settings, usable_device
from juicer.progress import MetricSink, NullMetricSink, Progress, silent_progress
from juicer.tasks.specification import CriticalState, Insertion
from juicer.training.optimisation import Optimisation, Schedule, require_number
from juicer.training.source import BatchOrder
from juicer.training.state import TrainingState, load_state, save_state

WEIGHT_DECAY = 1e-2
WARMUP_STEPS = 50
AVERAGE_DECAY = 0.998
"""Of the moving average of the weights, which is what is kept."""
LARGEST_GRADIENT = 1.0
REPORT_EVERY = 50
SAVE_EVERY = 250
MEASURED_AT_ONCE = 256
_BASE, _PART, _IN_TARGET = range(3)
"""Places in what :func:`read_pair` yields."""


@dataclass(frozen=True)
class Errors:
    """How far an estimator is off.

    Attributes:
        loss: Over all states.
        error_mm: By name of a critical state, the mean distance at the states close to it between where a part is and
            where it seems to be: one that is grasped as seen from the gripper, one that is inserted from its target.
        error_deg: Likewise, the mean angle between its axis and what seems to be it.
    """

    loss: float
    error_mm: Mapping[str, float]
    error_deg: Mapping[str, float]


@dataclass(frozen=True)
class Learned:
    """What an estimator has learned.

    Attributes:
        estimator: With averaged weights.
        loss: At the end, of the states that it learned from.
        errors: On those that were held out.
        facts: Device and precision with which it has learned.
    """

    estimator: Estimator
    loss: float
    errors: Errors
    facts: Mapping[str, str]


def learn(
    estimator: Estimator,
    drawn: DrawnStates,
    held_out: DrawnStates,
    critical_states: Sequence[tuple[str, CriticalState]],
    *,
    seed: int,
    identity: str,
    scratch: Path | None = None,
    device: str = "cpu",
    progress: Progress = silent_progress,
    metrics: MetricSink | None = None,
) -> Learned:
    """Teach an estimator what is true of drawn states.

    Args:
        estimator: With initial weights; it is changed.
        drawn: States to learn from.
        held_out: States to be measured on.
        critical_states: Names and kinds of the task's critical states, by index.
        seed: Decides the order of the states.
        identity: Of what is learned: an unfinished training in ``scratch`` of another one is passed over.
        scratch: Folder for the state of an unfinished training, from which it continues.
        device: Torch device.
        progress: Called with the steps done, the loss and the seconds left.
        metrics: Called with the loss.

    Raises:
        TrainingFailed: If the loss is no longer a number.
        ConfigError: If there is no such device.
    """
    torch_device = usable_device(device)
    shares = torch_device.type == "cpu" and not _takes_statistics(estimator)
    threads = estimator.config.estimator.threads if shares else 1
    with compute_settings(1, "medium"), ThreadPoolExecutor(threads) as pool:
        loop = _Loop(estimator, drawn, torch_device, seed, pool, threads)
        loss = loop.run(identity, scratch, progress, metrics or NullMetricSink())
        errors = measure(loop.acting, held_out, critical_states)
    return Learned(loop.acting.cpu(), loss, errors, {"device": torch_device.type, "precision": loop.precision})


def _takes_statistics(estimator: Estimator) -> bool:
    """Whether batches change statistics of the network: threads that share it would do so in any order."""
    has_any = any(isinstance(module, BatchNorm) for module in estimator.modules())
    return has_any and BatchNorm.takes_statistics(estimator.config.estimator.batch_size)


class _Loop:
    """Steps, reports and saves in their order.

    Each thread of a pool takes a part of the batch. Torch's own threads meet at every operation and wait for each other
    by spinning: on processors that somebody else uses, too, two of them are slower than one.
    """

    def __init__(
        self,
        estimator: Estimator,
        drawn: DrawnStates,
        device: torch.device,
        seed: int,
        pool: ThreadPoolExecutor,
        parts: int,
    ) -> None:
        self._pool, self._parts = pool, parts
        self._config = config = estimator.config.estimator
        self._drawn = drawn
        features = _true_features(estimator, drawn)
        estimator.normalizer.fit(features)
        self._features = features.to(device)
        self._estimator = estimator.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._device = device
        self.precision = chosen_precision(config.precision, device)
        schedule = Schedule(config.learning_rate, WARMUP_STEPS, config.steps)
        self._optimisation: Optimisation[Estimator] = Optimisation(
            self._estimator, schedule, weight_decay=WEIGHT_DECAY, average_decay=AVERAGE_DECAY
        )
        self._order = BatchOrder(len(drawn), config.batch_size, seed)

    @property
    def acting(self) -> Estimator:
        return self._optimisation.acting

    def run(self, identity: str, scratch: Path | None, progress: Progress, metrics: MetricSink) -> float:
        steps, loss_sum, shown = self._config.steps, 0.0, math.nan
        first = self._resume(identity, scratch)
        started = time.monotonic()
        for step in range(first, steps):
            loss_sum += self._learn(step)
            done = step + 1
            if done % REPORT_EVERY == 0 or done == steps:
                shown, loss_sum = loss_sum / (done % REPORT_EVERY or REPORT_EVERY), 0.0
                require_number(shown, done, f"lower learning_rate of the estimator (now {self._config.learning_rate})")
                metrics.log({"train/loss": shown}, done)
                left = (time.monotonic() - started) / (done - first) * (steps - done)
                progress(done, steps, loss=shown, seconds_left=round(left))
            if scratch is not None and done % SAVE_EVERY == 0 and done < steps:
                save_state(scratch, TrainingState(identity, done, self._optimisation.tensors()))
        return shown

    def _learn(self, step: int) -> float:
        # Taken in the order in which they lie on the disk.
        rows = self._order.rows(step).sort().values
        losses, gradients = zip(*self._pool.map(self._gradients, rows.chunk(self._parts)), strict=True)
        parameters = self._optimisation.parameters
        for parameter, parts in zip(parameters, zip(*gradients, strict=True), strict=True):
            parameter.grad = sum(parts[1:], start=parts[0])
        torch.nn.utils.clip_grad_norm_(parameters, LARGEST_GRADIENT)
        self._optimisation.step(step)
        return float(sum(losses))

    def _gradients(self, rows: Tensor) -> tuple[float, tuple[Tensor, ...]]:
        """What a part of a batch contributes to the loss, and to the gradient of every weight."""
        images = [torch.from_numpy(images[rows.numpy()]).to(self._device) for images in self._drawn.images.values()]
        features = self._features[rows]
        with torch.autocast(self._device.type, torch.bfloat16, enabled=self.precision == "bf16"):
            seen = self._estimator.see(images, features[:, :PROPRIOCEPTION_SIZE])
            loss = self._estimator.compute_loss(seen, features) * (len(rows) / self._config.batch_size)
        return float(loss.detach()), torch.autograd.grad(loss, self._optimisation.parameters)

    def _resume(self, identity: str, scratch: Path | None) -> int:
        state = None if scratch is None else load_state(scratch, identity)
        if state is None:
            return 0
        self._optimisation.restore(state.tensors, state.step)
        return state.step


@torch.inference_mode()
def measure(estimator: Estimator, drawn: DrawnStates, critical_states: Sequence[tuple[str, CriticalState]]) -> Errors:
    """How far an estimator is off, over all states and close to each critical state."""
    device = estimator.normalizer.offset.device
    views = estimator.config.estimator.views.values()
    true = _true_features(estimator, drawn)
    estimates, loss = [], 0.0
    for start in range(0, len(drawn), MEASURED_AT_ONCE):
        rows = slice(start, start + MEASURED_AT_ONCE)
        images = [torch.from_numpy(np.array(drawn.images[view.name][rows])).to(device) for view in views]
        features = true[rows].to(device)
        proprioception = features[:, :PROPRIOCEPTION_SIZE]
        seen = estimator.see(images, proprioception)
        estimates.append(estimator.features(seen, proprioception).cpu())
        loss += len(features) * float(estimator.compute_loss(seen, features))
    config = estimator.config.features
    estimated = torch.cat(estimates)
    error_mm, error_deg = {}, {}
    for index, (name, state) in enumerate(critical_states):
        close = torch.from_numpy(drawn.critical_states == index)
        if close.any():
            place = _pair_of(state, estimator.spec) if config.pairs == "all" else 0
            found, truth = (read_pair(each[close], config, place) for each in (estimated, true))
            distance_m = (found.offsets_m - truth.offsets_m).norm(dim=-1)
            angle_rad = torch.acos((found.axes * truth.axes).sum(dim=-1).clamp(-1, 1))
            what = _IN_TARGET if isinstance(state, Insertion) else _BASE if state.part == 0 else _PART
            error_mm[name] = 1000 * float(distance_m[:, what].mean())
            error_deg[name] = float(angle_rad[:, what].rad2deg().mean())
    return Errors(loss / max(len(drawn), 1), error_mm, error_deg)


def _pair_of(state: CriticalState, spec: FeatureSpec) -> int:
    """Which pair a critical state is of; the base, which is the first part of pairs alone, is seen with the first."""
    if isinstance(state, Insertion):
        return state.pair
    return next((number for number, pair in enumerate(spec.pairs) if pair.second == state.part), 0)


def _true_features(estimator: Estimator, drawn: DrawnStates) -> Tensor:
    observations = {name: torch.from_numpy(np.asarray(values)) for name, values in drawn.observations.items()}
    return state_features(observations, estimator.spec, estimator.config.features)
