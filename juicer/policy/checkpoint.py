"""A policy as files: weights in safetensors, everything needed to rebuild it in JSON; nothing is ever unpickled."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import torch
from pydantic import Field, ValidationError
from safetensors.torch import save_file
from torch import Tensor

from juicer.config import StrictConfig
from juicer.errors import ConfigError, InvalidCheckpoint
from juicer.policy.acting import TrainedPolicy
from juicer.policy.config import MOST_PARAMETERS, MOST_TASKS, FeatureSpec, PolicyConfig, sampled_in
from juicer.policy.network import PolicyNetwork, build_policy
from juicer.policy.refusals import refusals_as_os_errors
from juicer.policy.replay import REPLAY_FILE, ReplayPolicy, load_replay
from juicer.policy.tensor_files import opened_tensors
from juicer.problems import first_problem, show
from juicer.reading import read_bounded
from juicer.text import printable

SCHEMA_VERSION = 5
POLICY_FILE = "policy.json"
WEIGHT_FILES = {"raw": "weights.safetensors", "ema": "ema.safetensors"}
MOST_METADATA_BYTES = 1_000_000


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
    """

    metadata: CheckpointMetadata
    weights: Mapping[str, Tensor]
    ema: Mapping[str, Tensor] | None

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

    def policy(self, task: str, device: str = "cpu", inference_steps: int | None = None) -> TrainedPolicy:
        """The policy, ready to act on a task, on a torch device; see :meth:`network`.

        Raises:
            InvalidCheckpoint: If it was not trained for the task.
            ConfigError: If there is no such device, or its head cannot sample in so many steps.
        """
        return TrainedPolicy(self.network(inference_steps), task, device=device)


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
    """Read a checkpoint folder, which anybody may have written: nothing is built before it is known to be sensible.

    Raises:
        InvalidCheckpoint: If a file is missing, damaged, too large, of a schema this version cannot read, or not what
            the configuration of the policy says.
    """
    metadata = _read_metadata(folder / POLICY_FILE)
    expected = _expected_weights(metadata)
    ema = folder / WEIGHT_FILES["ema"]
    needs_ema = metadata.acting_weights == "ema"
    return Checkpoint(
        metadata=metadata,
        weights=_read_weights(folder / WEIGHT_FILES["raw"], expected),
        ema=_read_weights(ema, expected) if needs_ema or ema.exists() else None,
    )


def load_policy(
    folder: Path,
    task: str,
    max_steps: int | None = None,
    device: str = "cpu",
    inference_steps: int | None = None,
) -> TrainedPolicy | ReplayPolicy:
    """The policy of a checkpoint folder, ready to act on a task.

    Args:
        folder: Payload of a checkpoint.
        task: Assembly task that is to be done.
        max_steps: Steps that an episode may take, if not as many as the task allows.
        device: Torch device that computes the actions; a replay computes nothing.
        inference_steps: Steps in which its head samples a chunk, if not as many as it was configured with.

    Raises:
        InvalidCheckpoint: See :func:`load_checkpoint`; or if the policy was not trained for the task.
        ConfigError: If there is no such device, or it cannot sample in so many steps.
    """
    if (replay := folder / REPLAY_FILE).exists() or replay.is_symlink():
        if inference_steps is not None:
            raise ConfigError("a replay has no inference_steps to choose")
        return load_replay(replay, task, max_steps)
    return load_checkpoint(folder).policy(task, device, inference_steps)


def _read_metadata(path: Path) -> CheckpointMetadata:
    if path.is_symlink():
        raise InvalidCheckpoint(f"'{path}' is a link; a checkpoint holds its files itself")
    try:
        content = json.loads(read_bounded(path, MOST_METADATA_BYTES), object_pairs_hook=_without_duplicates)
    except FileNotFoundError:
        raise InvalidCheckpoint(f"'{path.parent}' is not a checkpoint: it has no {POLICY_FILE}") from None
    except OSError as error:
        raise InvalidCheckpoint(f"'{path}' cannot be read: {error.strerror or error}") from None
    except RecursionError:
        raise InvalidCheckpoint(f"'{path}' cannot be read: it is nested too deep") from None
    except ValueError as error:
        raise InvalidCheckpoint(f"'{path}' cannot be read: {printable(error)}") from None
    version = content.get("schema_version") if isinstance(content, dict) else None
    if type(version) is not int or version != SCHEMA_VERSION:
        older = type(version) is int and 0 < version < SCHEMA_VERSION
        remedy = "train the policy again" if older else "use the version of juicer that wrote it"
        raise InvalidCheckpoint(
            f"'{path}' has schema version {show(version)}, this version of juicer reads {SCHEMA_VERSION}; {remedy}"
        )
    try:
        return CheckpointMetadata.model_validate(content)
    except ValidationError as error:
        problem = first_problem(error, content, CheckpointMetadata)
        raise InvalidCheckpoint(f"'{path}' is not valid: {problem.sentence}") from None


def _write_weights(path: Path, weights: Mapping[str, Tensor]) -> None:
    with refusals_as_os_errors(path):
        save_file(dict(weights), path)


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        raise ValueError("a key is there twice")
    return content


def _expected_weights(metadata: CheckpointMetadata) -> Mapping[str, Tensor]:
    """State that a network of this configuration has, without memory behind it."""
    with torch.device("meta"):
        expected = PolicyNetwork(metadata.policy, metadata.tasks).state_dict()
    size = sum(tensor.numel() for tensor in expected.values())
    if size > MOST_PARAMETERS:
        raise InvalidCheckpoint(f"a policy of {size:,} weights is too large; at most {MOST_PARAMETERS:,} are taken")
    return expected


def _read_weights(path: Path, expected: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Weights from a file.

    Raises:
        InvalidCheckpoint: If names, shapes or types are others than expected, or a weight is not finite.
    """
    with opened_tensors(path, "pt", sum(tensor.nbytes for tensor in expected.values())) as file:
        if strange := sorted(set(file.keys()) ^ set(expected)):
            raise _misfit(path, f"'{printable(strange[0])}' is {'missing' if strange[0] in expected else 'too much'}")
        for name, tensor in expected.items():
            if (shape := tuple(file.get_slice(name).get_shape())) != tensor.shape:
                raise _misfit(path, f"'{name}' has shape {shape}, not {tuple(tensor.shape)}")
        weights = {name: file.get_tensor(name) for name in expected}
    for name, tensor in weights.items():
        if tensor.dtype != expected[name].dtype:
            raise _misfit(path, f"'{name}' is of type {tensor.dtype}, not {expected[name].dtype}")
        if not bool(tensor.isfinite().all()):
            raise InvalidCheckpoint(f"weights '{path}' cannot be used: '{name}' holds numbers that are not finite")
    return weights


def _misfit(path: Path, difference: str) -> InvalidCheckpoint:
    return InvalidCheckpoint(f"'{path}' does not fit its own configuration: {difference}")


def _fill(network: PolicyNetwork, weights: Mapping[str, Tensor], origin: str) -> None:
    try:
        network.load_state_dict(dict(weights))
    except RuntimeError as error:
        raise InvalidCheckpoint(
            f"{origin} does not fit its own configuration: {' '.join(str(error).split())}"
        ) from None
