"""The training loop: the same data, settings and seed give the same weights, however often it is interrupted."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from juicer.errors import ConfigError, TrainingFailed
from juicer.policy.checkpoint import SCHEMA_VERSION, Checkpoint, CheckpointMetadata
from juicer.policy.config import HorizonConfig, PolicyConfig
from juicer.policy.network import PolicyNetwork, build_policy
from juicer.policy.pretrained.config import Weights
from juicer.policy.pretrained.files import DEFAULT_FOLDER
from juicer.policy.pretrained.loading import load_pretrained
from juicer.policy.tasks import Tasks
from juicer.policy.torch_settings import compute_settings, usable_device
from juicer.progress import MetricSink, NullMetricSink, Progress, silent_progress
from juicer.seeding import stream
from juicer.training.config import OriginalStateNoise, TrainingConfig
from juicer.training.learner import Learner, learning_rate, torch_seed
from juicer.training.source import BatchOrder, WindowSource
from juicer.training.state import TrainingState, load_state, save_state, training_identity
from juicer.training.table import WindowTable
from juicer.training.use import SourceUse, check_use, measure_use, notable_losses
from juicer.training.validation import validate
from juicer.training.windows import TrainingEpisodes, Windows, concatenate, cut_windows, split_episodes, window_weights


@dataclass(frozen=True)
class TrainedCheckpoint:
    """What a training leaves behind.

    Attributes:
        checkpoint: Weights and configuration.
        facts: Worth knowing: device and precision, size of network and data, last losses and validation.
        use: What its windows reach of the episodes of every source.
        losses: A sentence for every source of which a notable share went unused.
    """

    checkpoint: Checkpoint
    facts: Mapping[str, float | str]
    use: Mapping[str, SourceUse]
    losses: tuple[str, ...]


@dataclass(frozen=True)
class WindowSources:
    """Windows to learn from, and those of the held-out episodes if there are any."""

    learned: WindowSource
    held_out: WindowSource | None


def train(
    sources: Sequence[TrainingEpisodes],
    policy: PolicyConfig,
    tasks: Tasks,
    config: TrainingConfig,
    *,
    seed: int,
    estimators: Sequence[Path] = (),
    scratch: Path | None = None,
    device: str = "cpu",
    weights: Path = DEFAULT_FOLDER,
    progress: Progress = silent_progress,
    metrics: MetricSink | None = None,
) -> TrainedCheckpoint:
    """Train a policy by imitation.

    Args:
        sources: Episodes to imitate; all windows are equally likely, unless episodes have weights. Several are copied
            into one, so those with more images than the memory holds must be one.
        policy: What the policy is made of.
        tasks: Assembly tasks that the episodes show.
        config: How to train.
        seed: Decides initial weights, split, order and noise.
        estimators: Folders of estimators, for encoders that need some.
        scratch: Folder for the state of an unfinished training. If it holds one of the same data and settings,
            training continues from it, bit for bit on a CPU.
        device: Torch device; a fact about the machine, not part of what is trained.
        weights: Where files of pretrained weights are looked for first.
        progress: Called with the steps done, the loss and the seconds left.
        metrics: Called with loss, learning rate and validation.

    Raises:
        ConfigError: If settings contradict each other, or there is no such device.
        TrainingFailed: If there is too little data, or windows leave out most of it, or the loss is no longer a number.
        UnusableWeights: If the policy is to start from pretrained weights and their file is missing or another one.
    """
    torch_device = usable_device(device)
    _check_noise(policy, config)
    episodes = concatenate(sources)
    learned, held_out = cut_sides(episodes, policy.horizons, config, seed)
    use = measure_use(episodes, learned, held_out)
    check_use(use, policy.horizons, config.windows.back_padding)
    devices = [] if torch_device.type == "cpu" else [torch_device]
    with compute_settings(config.threads, "medium"), torch.random.fork_rng(devices):
        network = build_policy(policy, tasks, torch_seed(seed, "weights")).to(torch_device)
        network.encoders.take_estimators(estimators)
        pretrained = load_pretrained(network, weights)
        windows = window_sources(episodes, (learned, held_out), network, config, seed, torch_device)
        learner = Learner(network, config, seed, torch_device)
        order = BatchOrder(len(windows.learned), config.batch_size, seed, window_weights(episodes, learned))
        loop = _Loop(learner, windows, config, order, metrics or NullMetricSink())
        identity = training_identity(episodes, _settings(policy, tasks, config, seed))
        facts = loop.run(identity, scratch, progress)
    machine = {"device": torch_device.type, "precision": learner.precision, **_origins(pretrained)}
    return TrainedCheckpoint(
        checkpoint=_checkpoint(learner, config.steps),
        facts={**machine, **facts},
        use=use,
        losses=tuple(notable_losses(use, policy.horizons, config.windows.back_padding)),
    )


def _origins(pretrained: Sequence[Weights]) -> dict[str, str]:
    """Which weights a policy started from, and what may be done with them."""
    return {"pretrained": ", ".join(f"{each.file} ({each.licence})" for each in pretrained)} if pretrained else {}


def _checkpoint(learner: Learner, step: int) -> Checkpoint:
    network = learner.network
    metadata = CheckpointMetadata(
        schema_version=SCHEMA_VERSION,
        policy=network.config,
        tasks=dict(network.tasks),
        acting_weights="raw" if learner.ema is None else "ema",
        step=step,
    )
    return Checkpoint(metadata, _on_cpu(network), None if learner.ema is None else _on_cpu(learner.ema))


def cut_sides(
    episodes: TrainingEpisodes, horizons: HorizonConfig, config: TrainingConfig, seed: int
) -> tuple[Windows, Windows]:
    """Windows to learn from, and those of the held-out episodes.

    Raises:
        TrainingFailed: If a validation set is wanted but there is only one family of episodes.
    """
    learned, held_out = split_episodes(episodes.families, config.validation_fraction, stream(seed, "split"))
    padding = config.windows.back_padding
    return (
        cut_windows(episodes.episode_ends, learned, horizons, padding),
        cut_windows(episodes.episode_ends, held_out, horizons, padding),
    )


def window_sources(
    episodes: TrainingEpisodes,
    sides: tuple[Windows, Windows],
    network: PolicyNetwork,
    config: TrainingConfig,
    seed: int,
    device: torch.device,
) -> WindowSources:
    """Make the windows of both sides of the split ready, and fit the network's normalisers to those it learns from.

    Raises:
        TrainingFailed: If a side of the split has no window.
    """
    tables = [
        WindowTable(episodes, windows, network, config.windows.learn_padding, device)
        for windows in sides
        if len(windows.episodes)
    ]
    torch.manual_seed(torch_seed(seed, "limits"))
    tables[0].fit(config.state_noise)
    for table in tables:
        table.normalize()
    return WindowSources(learned=tables[0], held_out=tables[1] if len(tables) > 1 else None)


class _Loop:
    """Steps, reports, validations and saves in their order."""

    def __init__(
        self, learner: Learner, windows: WindowSources, config: TrainingConfig, order: BatchOrder, metrics: MetricSink
    ) -> None:
        self._learner = learner
        self._windows = windows
        self._config = config
        self._metrics = metrics
        self._order = order
        self._loss_sum = torch.zeros(())
        self._facts = {
            "num_parameters": float(learner.network.num_parameters),
            "num_windows": float(len(windows.learned)),
        }

    def run(self, identity: str, scratch: Path | None, progress: Progress) -> Mapping[str, float]:
        """Train to the end, from the state in ``scratch`` if there is one; returns facts about the result."""
        config = self._config
        first = self._resume(identity, scratch)
        started = time.monotonic()
        for step in range(first, config.steps):
            self._learner.seed_step(step)
            batch = self._windows.learned.gather(self._order.rows(step), config.state_noise)
            self._loss_sum += self._learner.learn(batch, step).cpu()
            done = step + 1
            if done % config.report_every == 0 or done == config.steps:
                self._report(done)
                seconds_left = (time.monotonic() - started) / (done - first) * (config.steps - done)
                progress(done, config.steps, loss=self._facts["train/loss"], seconds_left=round(seconds_left))
            if done % config.validate_every == 0 or done == config.steps:
                self._validate(done)
            if scratch is not None and done % config.save_every == 0 and done < config.steps:
                tensors = {**self._learner.tensors(), "loss_sum": self._loss_sum}
                save_state(scratch, TrainingState(identity, done, tensors))
        return self._facts

    def _resume(self, identity: str, scratch: Path | None) -> int:
        state = None if scratch is None else load_state(scratch, identity)
        if state is None:
            return 0
        self._learner.restore(state.tensors, state.step)
        self._loss_sum = state.tensors["loss_sum"].clone()
        return state.step

    def _report(self, done: int) -> None:
        num_summed = done % self._config.report_every or self._config.report_every
        loss = float(self._loss_sum) / num_summed
        self._loss_sum.zero_()
        if not math.isfinite(loss):
            raise TrainingFailed(
                f"the loss is no longer a number by step {done}; lower training.learning_rate "
                f"(now {self._config.learning_rate}) or look for outliers in the episodes"
            )
        rate = learning_rate(done - 1, self._config)
        self._record({"train/loss": loss, "train/learning_rate": rate}, done)

    def _validate(self, done: int) -> None:
        if self._windows.held_out is not None:
            self._record(validate(self._learner.acting, self._windows.held_out), done)

    def _record(self, metrics: Mapping[str, float], step: int) -> None:
        self._metrics.log(metrics, step)
        self._facts |= metrics


def _check_noise(policy: PolicyConfig, config: TrainingConfig) -> None:
    if isinstance(config.state_noise, OriginalStateNoise) and policy.action_frame != "absolute":
        raise ConfigError(
            "state_noise 'original' perturbs normalised numbers, from which no pose for relative actions can be "
            "taken; use state_noise 'physical' or action_frame 'absolute'"
        )


def _settings(policy: PolicyConfig, tasks: Tasks, config: TrainingConfig, seed: int) -> dict[str, object]:
    sections = {"policy": policy, "training": config, **{f"task {name}": spec for name, spec in tasks.items()}}
    return {"seed": seed, **{name: section.model_dump(mode="json") for name, section in sections.items()}}


def _on_cpu(network: PolicyNetwork) -> dict[str, Tensor]:
    return {name: value.detach().cpu() for name, value in network.state_dict().items()}
