"""A policy as files: weights in safetensors, everything needed to rebuild it in JSON; nothing is ever unpickled."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import ValidationError
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from juicer.config import StrictConfig
from juicer.errors import InvalidCheckpoint
from juicer.policy.config import FeatureSpec, PolicyConfig
from juicer.policy.network import PolicyNetwork, build_policy
from juicer.policy.policy import TrainedPolicy
from juicer.policy.refusals import refusals_as_os_errors
from juicer.policy.replay import REPLAY_FILE, ReplayPolicy, load_replay

SCHEMA_VERSION = 4
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

    schema_version: int = SCHEMA_VERSION
    policy: PolicyConfig
    tasks: dict[str, FeatureSpec]
    acting_weights: Literal["raw", "ema"]
    step: int


@dataclass(frozen=True)
class Checkpoint:
    """Weights and what they mean; limits of the normalisers are among the weights.

    Attributes:
        metadata: Content of ``policy.json``.
        weights: State of the network after the last step.
        ema: Moving average of the state, if one was kept.
    """

    metadata: CheckpointMetadata
    weights: Mapping[str, Tensor]
    ema: Mapping[str, Tensor] | None

    def policy(self, task: str, device: str = "cpu") -> TrainedPolicy:
        """The policy, ready to act on a task, on a torch device.

        Raises:
            InvalidCheckpoint: If it was not trained for the task.
            ConfigError: If there is no such device.
        """
        weights = self.ema if self.metadata.acting_weights == "ema" else self.weights
        network = build_policy(self.metadata.policy, self.metadata.tasks, seed=0)
        _fill(network, weights or {}, "the checkpoint")
        return TrainedPolicy(network, task, device=device)


def save_checkpoint(folder: Path, checkpoint: Checkpoint) -> None:
    """Write ``policy.json``, ``weights.safetensors`` and, if there is one, ``ema.safetensors``.

    Raises:
        OSError: If the system refuses a write.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / POLICY_FILE).write_text(checkpoint.metadata.model_dump_json(indent=2) + "\n")
    _write_weights(folder / WEIGHT_FILES["raw"], checkpoint.weights)
    if checkpoint.ema is not None:
        _write_weights(folder / WEIGHT_FILES["ema"], checkpoint.ema)


def load_checkpoint(folder: Path) -> Checkpoint:
    """Read a checkpoint folder.

    Raises:
        InvalidCheckpoint: If a file is missing or damaged, or of a schema this version cannot read.
    """
    metadata = _read_metadata(folder / POLICY_FILE)
    ema = folder / WEIGHT_FILES["ema"]
    needs_ema = metadata.acting_weights == "ema"
    return Checkpoint(
        metadata=metadata,
        weights=_read_weights(folder / WEIGHT_FILES["raw"]),
        ema=_read_weights(ema) if needs_ema or ema.exists() else None,
    )


def load_policy(
    folder: Path, task: str, max_steps: int | None = None, device: str = "cpu"
) -> TrainedPolicy | ReplayPolicy:
    """The policy of a checkpoint folder, ready to act on a task.

    Args:
        folder: Payload of a checkpoint.
        task: Assembly task that is to be done.
        max_steps: Steps that an episode may take, if not as many as the task allows.
        device: Torch device that computes the actions; a replay computes nothing.

    Raises:
        InvalidCheckpoint: See :func:`load_checkpoint`; or if the policy was not trained for the task.
        ConfigError: If there is no such device.
    """
    if (replay := folder / REPLAY_FILE).exists():
        return load_replay(replay, task, max_steps)
    return load_checkpoint(folder).policy(task, device)


def _read_metadata(path: Path) -> CheckpointMetadata:
    try:
        content = json.loads(path.read_text())
    except FileNotFoundError:
        raise InvalidCheckpoint(f"'{path.parent}' is no checkpoint: it has no {POLICY_FILE}") from None
    except (OSError, ValueError) as error:
        raise InvalidCheckpoint(f"'{path}' cannot be read: {error}") from None
    version = content.get("schema_version") if isinstance(content, dict) else None
    if version != SCHEMA_VERSION:
        raise InvalidCheckpoint(f"'{path}' has schema version {version}, this version of juicer reads {SCHEMA_VERSION}")
    try:
        return CheckpointMetadata.model_validate(content)
    except ValidationError as error:
        problem = error.errors()[0]
        where = ".".join(str(part) for part in problem["loc"])
        raise InvalidCheckpoint(f"'{path}' is not valid: {where}: {problem['msg']}") from None


def _write_weights(path: Path, weights: Mapping[str, Tensor]) -> None:
    with refusals_as_os_errors(path):
        save_file(dict(weights), path)


def _read_weights(path: Path) -> dict[str, Tensor]:
    try:
        return load_file(path)
    except (OSError, SafetensorError) as error:
        raise InvalidCheckpoint(f"weights '{path}' cannot be read: {error}") from None


def _fill(network: PolicyNetwork, weights: Mapping[str, Tensor], origin: str) -> None:
    try:
        network.load_state_dict(dict(weights))
    except RuntimeError as error:
        raise InvalidCheckpoint(
            f"{origin} does not fit its own configuration: {' '.join(str(error).split())}"
        ) from None
