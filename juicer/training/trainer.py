"""The training loop: the same data, settings and seed give the same weights, however often it is interrupted."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from juicer.errors import ConfigError
from juicer.policy.checkpoint import SCHEMA_VERSION, Checkpoint, CheckpointMetadata, go_on_from
from juicer.policy.config import HorizonConfig, PolicyConfig
from juicer.policy.encoder import Encoders
from juicer.policy.network import PolicyNetwork, build_policy
from juicer.policy.pretrained.files import DEFAULT_FOLDER
from juicer.policy.pretrained.loading import Pretrained, load_pretrained
from juicer.policy.tasks import Tasks
from juicer.policy.torch_settings import compute_settings, usable_device
from juicer.progress import MetricSink, NullMetricSink, Progress, silent_progress
from juicer.seeding import stream
from juicer.training.config import OriginalStateNoise, TrainingConfig
from juicer.training.feed import Feed
from juicer.training.learner import Learner, torch_seed
from juicer.training.optimisation import require_number
from juicer.training.ranks import Ranks, current_ranks
from juicer.training.source import Batch, BatchOrder, WindowSource
from juicer.training.state import TrainingState, load_state, save_state, training_identity
from juicer.training.table import WindowTable
from juicer.training.use import SourceUse, check_tasks, check_use, measure_use, notable_losses
from juicer.training.validation import validate
from juicer.training.windows import TrainingEpisodes, Windows, concatenate, cut_windows, split_episodes, window_weights

LONGEST_UNSAVED_S = 60.0
"""Steps of large images take seconds each: so long at most does a training learn before its state is saved."""
LOADERS = 4
"""Processes that gather the images of a batch beside a GPU, if nobody says how many."""


@dataclass(frozen=True)
class TrainedCheckpoint:
    """What a training leaves behind.

    Attributes:
        checkpoint: Weights and configuration.
        observes: What the policy sees, and what it was taught with that it does not see, before this training too.
        facts: Worth knowing: device and precision, size of network and data, last losses and validation.
        use: What its windows reach of the episodes of every source.
        losses: A sentence for every source of which a notable share went unused.
    """

    checkpoint: Checkpoint
    observes: str
    facts: Mapping[str, float | str]
    use: Mapping[str, SourceUse]
    losses: tuple[str, ...]


@dataclass(frozen=True)
class WindowSources:
    """Windows to learn from, and those of the held-out episodes if there are any."""

    learned: WindowSource
    held_out: WindowSource | None


@dataclass(frozen=True)
class Imitation:
    """What is trained.

    Attributes:
        episodes: What it imitates.
        sides: Windows of them to learn from, and those of the held-out ones.
        network: What learns.
        config: How.
        seed: Decides order and noise.
        goes_on: Whether the network has learned before, and has its limits from there.
    """

    episodes: TrainingEpisodes
    sides: tuple[Windows, Windows]
    network: PolicyNetwork
    config: TrainingConfig
    seed: int
    goes_on: bool = False

    def window_sources(self, device: torch.device) -> WindowSources:
        """Make the windows of both sides of the split ready, and fit the network's normalisers to those to learn from.

        A network that goes on keeps the limits that its weights mean.

        Raises:
            TrainingFailed: If a side of the split has no window.
        """
        network = self.network.to(device)
        tables = [
            WindowTable(self.episodes, windows, network, self.config.windows.learn_padding, device)
            for windows in self.sides
            if len(windows.episodes)
        ]
        torch.manual_seed(torch_seed(self.seed, "limits"))
        if not self.goes_on:
            tables[0].fit(self.config.state_noise)
        for table in tables:
            table.normalize()
        return WindowSources(learned=tables[0], held_out=tables[1] if len(tables) > 1 else None)


def train(
    sources: Sequence[TrainingEpisodes],
    policy: PolicyConfig,
    tasks: Tasks,
    config: TrainingConfig,
    *,
    seed: int,
    estimators: Sequence[Path] = (),
    start: Path | None = None,
    unpack: Callable[[], Mapping[str, NDArray[Any]]] = dict,
    scratch: Path | None = None,
    device: str = "cpu",
    loaders: int | None = None,
    weights: Path = DEFAULT_FOLDER,
    progress: Progress = silent_progress,
    metrics: MetricSink | None = None,
) -> TrainedCheckpoint:
    """Train a policy by imitation.

    Processes of torch's default group each take a part of every batch and end with the same weights; the first reports.

    Args:
        sources: Episodes to imitate, several copied into one; all windows are equally likely unless they have weights.
        policy: What the policy is made of.
        tasks: Assembly tasks that the episodes show.
        config: How to train.
        seed: Decides initial weights, split, order and noise.
        estimators: Folders of estimators, for encoders that need some.
        start: Folder of a checkpoint of the same policy whose acting weights and limits it goes on from, if any.
        unpack: Gives images of them, which the memory need not hold, once the network is known to be right.
        scratch: Folder for the state of an unfinished training; one of the same goes on, bit for bit on a CPU.
        device: Torch device; a fact about the machine, not part of what is trained.
        loaders: Processes that gather batches ahead; if None, some for a GPU and a policy that learns from images.
        weights: Where files of pretrained weights are looked for first.
        progress: Called with the steps done, the loss and the seconds left.
        metrics: Called with loss, learning rate and validation.

    Raises:
        ConfigError: If settings contradict each other, there is no such device, or the start is of another policy.
        TrainingFailed: If there is too little data, or windows leave out most of it, or the loss is no longer a number.
        UnusableWeights: If the policy is to start from pretrained weights and their file is missing or another one.
    """
    torch_device = usable_device(device)
    _check_noise(policy, config)
    episodes = concatenate(sources)
    sides = cut_sides(episodes, policy.horizons, config, seed)
    use = measure_use(episodes, *sides)
    check_use(use, policy.horizons, config.windows.back_padding)
    with compute_settings(config.threads, "medium"), _own_randomness(torch_device):
        network, pretrained = _built(policy, tasks, seed, weights, estimators, start)
        episodes = replace(episodes, observations={**episodes.observations, **unpack()})
        loop = _set_up(Imitation(episodes, sides, network, config, seed, bool(start)), torch_device, loaders, metrics)
        facts = loop.run(training_identity(episodes, _settings(policy, tasks, config, seed, start)), scratch, progress)
    return TrainedCheckpoint(
        checkpoint=_checkpoint(loop.learner, config.steps, pretrained),
        observes=_observes(network, pretrained),
        facts=_known_before(loop.learner, torch_device, pretrained) | dict(facts),
        use=use,
        losses=tuple(notable_losses(use, policy.horizons, config.windows.back_padding)),
    )


def _own_randomness(device: torch.device) -> AbstractContextManager[None]:
    return torch.random.fork_rng([] if device.type == "cpu" else [device])


def _built(
    policy: PolicyConfig, tasks: Tasks, seed: int, weights: Path, estimators: Sequence[Path], start: Path | None
) -> tuple[PolicyNetwork, tuple[Pretrained, ...]]:
    """A network with all that it does not learn from nothing, and what it started from."""
    network = build_policy(policy, tasks, torch_seed(seed, "weights"))
    pretrained = load_pretrained(network, weights)
    if start:
        go_on_from(network, start)
    # Only now, as backbones of estimators start from files, too.
    network.encoders.take_estimators(estimators)
    return network, pretrained


def _started_from_poses(pretrained: Sequence[Pretrained]) -> bool:
    return any(each.poses_taught for each in pretrained)


def _observes(network: PolicyNetwork, pretrained: Sequence[Pretrained]) -> str:
    account = network.encoders.account
    return f"{account}, started from pose supervision" if _started_from_poses(pretrained) else account


def _known_before(learner: Learner, device: torch.device, pretrained: Sequence[Pretrained]) -> dict[str, float | str]:
    """Its device and arithmetic, and where its weights came from and what may be done with them."""
    facts: dict[str, float | str] = {"device": device.type, "precision": learner.precision}
    if pretrained:
        facts["pretrained"] = ", ".join(f"{weights.file} ({weights.licence})" for weights, _ in pretrained)
    return facts


def _checkpoint(learner: Learner, step: int, pretrained: Sequence[Pretrained]) -> Checkpoint:
    network = learner.network
    metadata = CheckpointMetadata(
        schema_version=SCHEMA_VERSION,
        policy=network.config,
        tasks=dict(network.tasks),
        acting_weights="raw" if learner.ema is None else "ema",
        step=step,
    )
    ema = None if learner.ema is None else _on_cpu(learner.ema)
    poses_taught = _started_from_poses(pretrained) or network.encoders.is_taught_unseen_poses
    return Checkpoint(metadata, _on_cpu(network), ema, poses_taught)


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


def _set_up(imitation: Imitation, device: torch.device, loaders: int | None, metrics: MetricSink | None) -> _Loop:
    """Bring together what learns, what it learns from, and who gathers that."""
    network, config, ranks = imitation.network, imitation.config, current_ranks()
    check_tasks(imitation.episodes, imitation.sides[0], list(network.tasks))
    loaders = default_loaders(network.encoders, device) if loaders is None else loaders
    # Processes beside the training have no use of its GPU: windows, and what prepares them, are not on it then.
    home = torch.device("cpu") if loaders else device
    windows = imitation.window_sources(home)
    learner = Learner(network if home == device else copy.deepcopy(network).to(device), config, device, ranks)
    weights = window_weights(imitation.episodes, imitation.sides[0])
    order = BatchOrder(len(windows.learned), config.batch_size, imitation.seed, weights)
    feed = Feed(windows.learned, order, config.state_noise, imitation.seed, ranks.part(config.batch_size))
    batches = partial(feed.batches, loaders=loaders, device=device)
    return _Loop(learner, batches, windows, config, ranks, metrics or NullMetricSink())


class _Loop:
    """Steps, reports, validations and saves in their order.

    Attributes:
        learner: What takes the steps.
    """

    def __init__(
        self,
        learner: Learner,
        batches: Callable[[int, int], Iterator[Batch]],
        windows: WindowSources,
        config: TrainingConfig,
        ranks: Ranks,
        metrics: MetricSink,
    ) -> None:
        self.learner = learner
        self._batches = batches
        self._held_out = windows.held_out
        self._config = config
        self._ranks = ranks
        self._metrics = metrics
        # Summed where losses are: asking for each would have the device wait for us at every step.
        self._loss_sum = torch.zeros((), device=next(learner.network.parameters()).device)
        self._facts = {
            "num_parameters": float(learner.network.num_parameters),
            "num_windows": float(len(windows.learned)),
        }

    def run(self, identity: str, scratch: Path | None, progress: Progress) -> Mapping[str, float]:
        """Train to the end, from the state in ``scratch`` if there is one; returns facts about the result."""
        config = self._config
        first = self._resume(identity, scratch)
        started = saved = time.monotonic()
        for step, batch in enumerate(self._batches(first, config.steps), first):
            self._loss_sum += self.learner.learn(batch, step)
            done = step + 1
            if done % config.report_every == 0 or done == config.steps:
                self._report(done)
                if self._ranks.leads:
                    seconds_left = (time.monotonic() - started) / (done - first) * (config.steps - done)
                    progress(done, config.steps, loss=self._facts["train/loss"], seconds_left=round(seconds_left))
            if not self._ranks.leads:
                continue
            if done % config.validate_every == 0 or done == config.steps:
                self._validate(done)
            is_due = done % config.save_every == 0 or time.monotonic() - saved > LONGEST_UNSAVED_S
            if scratch is not None and is_due and done < config.steps:
                tensors = {**self.learner.tensors(), "loss_sum": self._loss_sum}
                save_state(scratch, TrainingState(identity, done, tensors))
                saved = time.monotonic()
        return self._facts

    def _resume(self, identity: str, scratch: Path | None) -> int:
        state = None if scratch is None else load_state(scratch, identity)
        if state is None:
            return 0
        self.learner.restore(state.tensors, state.step)
        self._loss_sum.copy_(state.tensors["loss_sum"])
        return state.step

    def _report(self, done: int) -> None:
        num_summed = done % self._config.report_every or self._config.report_every
        loss = float(self._loss_sum) / num_summed
        self._loss_sum.zero_()
        now = self._config.learning_rate
        require_number(loss, done, f"lower training.learning_rate (now {now}) or look for outliers in the episodes")
        rate = self.learner.schedule.rate(done - 1)
        self._record({"train/loss": loss, "train/learning_rate": rate}, done)

    def _validate(self, done: int) -> None:
        if self._held_out is not None:
            self._record(validate(self.learner.acting, self._held_out), done)

    def _record(self, metrics: Mapping[str, float], step: int) -> None:
        if self._ranks.leads:
            self._metrics.log(metrics, step)
        self._facts |= metrics


def default_loaders(encoders: Encoders, device: torch.device) -> int:
    """Numbers of a whole dataset lie on the GPU; images are gathered by others while it computes."""
    return LOADERS if encoders.training_images and device.type != "cpu" else 0


def _check_noise(policy: PolicyConfig, config: TrainingConfig) -> None:
    if isinstance(config.state_noise, OriginalStateNoise) and policy.action_frame != "absolute":
        raise ConfigError(
            "state_noise 'original' perturbs normalised numbers, from which no pose for relative actions can be "
            "taken; use state_noise 'physical' or action_frame 'absolute'"
        )


def _settings(
    policy: PolicyConfig, tasks: Tasks, config: TrainingConfig, seed: int, start: Path | None
) -> dict[str, object]:
    sections = {"policy": policy, "training": config, **{f"task {name}": spec for name, spec in tasks.items()}}
    told = {"seed": seed, **{name: section.model_dump(mode="json") for name, section in sections.items()}}
    return told | ({"start": start.name} if start else {})


def _on_cpu(network: PolicyNetwork) -> dict[str, Tensor]:
    return {name: value.detach().cpu().contiguous() for name, value in network.state_dict().items()}
