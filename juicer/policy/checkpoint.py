"""A policy as files: weights in safetensors, everything needed to rebuild it in JSON; nothing is ever unpickled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from torch import Tensor

from juicer.config import StrictConfig
from juicer.errors import ConfigError, InvalidCheckpoint
from juicer.policy.acting import TrainedPolicy
from juicer.policy.config import MOST_TASKS, FeatureSpec, PolicyConfig, sampled_in
from juicer.policy.model_files import expected_weights, read_metadata, read_weights, write_weights
from juicer.policy.network import PolicyNetwork, build_policy
from juicer.policy.replay import REPLAY_FILE, ReplayPolicy, load_replay

SCHEMA_VERSION = 5
POLICY_FILE = "policy.json"
WEIGHT_FILES = {"raw": "weights.safetensors", "ema": "ema.safetensors"}


class CheckpointMetadata(StrictConfig):
    """Content of ``policy.json``.

    Attributes:
        schema_version: Layout of the checkpoint folder.
        policy: What the policy is made of.
        tasks: Assembly tasks it was trained for, with the numbers that its features need.
        acting_weights: Which weights act: those of the last step, or their moving average.
        step: Training steps taken.
    """

    schema_version: int = Field(default=SCHEMA_VERSION, ge=1, le=1000)
    policy: PolicyConfig
    tasks: dict[Annotated[str, Field(pattern=r"^\w[\w.-]*$", max_length=100)], FeatureSpec] = Field(
        min_length=1, max_length=MOST_TASKS
    )
    acting_weights: Literal["raw", "ema"]
    step: int = Field(ge=0, le=10**9)


@dataclass(frozen=True)
class Checkpoint:
    """Weights and what they mean; limits of the normalisers are among the weights.

    Attributes:
        metadata: Content of ``policy.json``.
        weights: State of the network after the last step.
        ema: Moving average of the state, if one was kept.
        poses_taught: Whether true poses of parts taught some of it to read images; written, not read.
    """

    metadata: CheckpointMetadata
    weights: Mapping[str, Tensor]
    ema: Mapping[str, Tensor] | None
    poses_taught: bool = False

    def network(self, inference_steps: int | None = None) -> PolicyNetwork:
        """The network that acts.

        Args:
            inference_steps: Steps in which its head samples a chunk, if not as many as it was configured with.

        Raises:
            InvalidCheckpoint: If the weights do not fit.
            ConfigError: If its head cannot sample in so many steps.
        """
        config = self.metadata.policy
        if inference_steps is not None:
            config = sampled_in(config, inference_steps)
        weights = self.ema if self.metadata.acting_weights == "ema" else self.weights
        network = build_policy(config, self.metadata.tasks, seed=0)
        _fill(network, weights or {}, "the checkpoint")
        return network

    def policy(
        self, task: str, device: str = "cpu", inference_steps: int | None = None, samples: int = 1
    ) -> TrainedPolicy:
        """The policy, ready to act on a task; see :meth:`network` and :class:`juicer.policy.acting.TrainedPolicy`.

        Raises:
            InvalidCheckpoint: If it was not trained for the task.
            ConfigError: If there is no such device, or its head cannot sample in so many steps, or not at all.
        """
        return TrainedPolicy(self.network(inference_steps), task, device=device, samples=samples)


def save_checkpoint(folder: Path, checkpoint: Checkpoint) -> None:
    """Write ``policy.json``, ``weights.safetensors`` and, if there is one, ``ema.safetensors``.

    Raises:
        OSError: If the system refuses a write.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / POLICY_FILE).write_text(checkpoint.metadata.model_dump_json(indent=2) + "\n")
    write_weights(folder / WEIGHT_FILES["raw"], checkpoint.weights, checkpoint.poses_taught)
    if checkpoint.ema is not None:
        write_weights(folder / WEIGHT_FILES["ema"], checkpoint.ema, checkpoint.poses_taught)


def load_checkpoint(folder: Path) -> Checkpoint:
    """Read a checkpoint folder, which anybody may have written: nothing is built before it is known to be sensible.

    Raises:
        InvalidCheckpoint: If a file is missing, damaged, too large, of a schema this version cannot read, or not what
            the configuration of the policy says.
    """
    path = folder / POLICY_FILE
    metadata = read_metadata(path, CheckpointMetadata, SCHEMA_VERSION, "a checkpoint", "train the policy again")
    expected = expected_weights(lambda: PolicyNetwork(metadata.policy, metadata.tasks), "a policy")
    ema = folder / WEIGHT_FILES["ema"]
    needs_ema = metadata.acting_weights == "ema"
    return Checkpoint(
        metadata=metadata,
        weights=read_weights(folder / WEIGHT_FILES["raw"], expected),
        ema=read_weights(ema, expected) if needs_ema or ema.exists() else None,
    )


def go_on_from(network: PolicyNetwork, folder: Path) -> None:
    """Give a network the weights that act in a checkpoint, and its limits.

    Raises:
        ConfigError: If the checkpoint is of another policy, or of other tasks.
        InvalidCheckpoint: See :func:`load_checkpoint`.
    """
    if (folder / REPLAY_FILE).exists():
        raise ConfigError("a replay has no weights that a training could go on from")
    checkpoint = load_checkpoint(folder)
    known = checkpoint.metadata
    if (known.policy, dict(known.tasks)) != (network.config, dict(network.tasks)):
        raise ConfigError(
            f"a training goes on only from the same policy for the same tasks, and that in '{folder.name}' is another: "
            "give one that was trained with these settings of the policy, or none"
        )
    weights = checkpoint.ema if known.acting_weights == "ema" else checkpoint.weights
    _fill(network, weights or {}, "the checkpoint")


def load_policy(
    folder: Path,
    task: str,
    max_steps: int | None = None,
    device: str = "cpu",
    inference_steps: int | None = None,
    samples: int = 1,
) -> TrainedPolicy | ReplayPolicy:
    """The policy of a checkpoint folder, ready to act on a task.

    Args:
        folder: Payload of a checkpoint.
        task: Assembly task that is to be done.
        max_steps: Steps that an episode may take, if not as many as the task allows.
        device: Torch device that computes the actions; a replay computes nothing.
        inference_steps: Steps in which its head samples a chunk, if not as many as it was configured with.
        samples: Chunks that are drawn at each prediction; of several, the one where they are densest is executed.

    Raises:
        InvalidCheckpoint: See :func:`load_checkpoint`; or if the policy was not trained for the task.
        ConfigError: If there is no such device, or it cannot sample in so many steps, or not at all.
    """
    if (replay := folder / REPLAY_FILE).exists() or replay.is_symlink():
        if inference_steps is not None:
            raise ConfigError("a replay has no inference_steps to choose")
        if samples > 1:
            raise ConfigError("a replay has no samples to choose among")
        return load_replay(replay, task, max_steps)
    return load_checkpoint(folder).policy(task, device, inference_steps, samples)


def _fill(network: PolicyNetwork, weights: Mapping[str, Tensor], origin: str) -> None:
    try:
        network.load_state_dict(dict(weights))
    except RuntimeError as error:
        raise InvalidCheckpoint(
            f"{origin} does not fit its own configuration: {' '.join(str(error).split())}"
        ) from None
