"""Weights in safetensors and what they mean in JSON, which anybody may have written: looked at before they are used."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch
from pydantic import BaseModel, ValidationError
from safetensors.torch import save_file
from torch import Tensor, nn

from juicer.config import ConfigT, models_in
from juicer.errors import InvalidCheckpoint
from juicer.policy.config import MOST_PARAMETERS
from juicer.policy.members import BackboneConfig
from juicer.policy.refusals import refusals_as_os_errors
from juicer.policy.tensor_files import opened_tensors
from juicer.problems import first_problem, show
from juicer.reading import read_bounded
from juicer.text import printable

MOST_METADATA_BYTES = 1_000_000
POSES_TAUGHT = {"taught_with": "poses"}
"""Metadata of a safetensors file some of whose weights were taught with true poses of parts to read images."""


def read_metadata(path: Path, model: type[ConfigT], version: int, what: str, anew: str) -> ConfigT:
    """What weights mean.

    Args:
        path: The file; a link to one is refused.
        model: Class of its content, of which ``schema_version`` is a field.
        version: The only schema version that is read.
        what: What the folder around it should be, e.g. ``a checkpoint``.
        anew: What to do about one of an older version, e.g. ``train the policy again``.

    Raises:
        InvalidCheckpoint: If it is missing, damaged, of another version, or not what the model says; or if the weights
            were learned by another network than is meant now.
    """
    if path.is_symlink():
        raise InvalidCheckpoint(f"'{path}' is a link; {what} holds its files itself")
    try:
        content = json.loads(read_bounded(path, MOST_METADATA_BYTES), object_pairs_hook=_without_duplicates)
    except FileNotFoundError:
        raise InvalidCheckpoint(f"'{path.parent}' is not {what}: it has no {path.name}") from None
    except OSError as error:
        raise InvalidCheckpoint(f"'{path}' cannot be read: {error.strerror or error}") from None
    except RecursionError:
        raise InvalidCheckpoint(f"'{path}' cannot be read: it is nested too deep") from None
    except ValueError as error:
        raise InvalidCheckpoint(f"'{path}' cannot be read: {printable(error)}") from None
    found = content.get("schema_version") if isinstance(content, dict) else None
    if type(found) is not int or found != version:
        older = type(found) is int and 0 < found < version
        remedy = anew if older else "use the version of juicer that wrote it"
        raise InvalidCheckpoint(
            f"'{path}' has schema version {show(found)}, this version of juicer reads {version}; {remedy}"
        )
    try:
        metadata = model.model_validate(content)
    except ValidationError as error:
        problem = first_problem(error, content, model)
        raise InvalidCheckpoint(f"'{path}' is not valid: {problem.sentence}") from None
    _check_backbones(path, metadata, anew)
    return metadata


def write_weights(path: Path, weights: Mapping[str, Tensor], poses_taught: bool = False) -> None:
    """Write a state.

    Args:
        path: The file.
        weights: The state.
        poses_taught: Whether true poses of parts taught some of it to read images; the file says so wherever it goes.

    Raises:
        OSError: If the system refuses the write.
    """
    with refusals_as_os_errors(path):
        save_file(dict(weights), path, POSES_TAUGHT if poses_taught else None)


def expected_weights(build: Callable[[], nn.Module], what: str) -> Mapping[str, Tensor]:
    """State that a network has, without memory behind it.

    Raises:
        InvalidCheckpoint: If ``what`` is too large to be taken.
    """
    with torch.device("meta"):
        expected = build().state_dict()
    size = sum(tensor.numel() for tensor in expected.values())
    if size > MOST_PARAMETERS:
        raise InvalidCheckpoint(f"{what} of {size:,} weights is too large; at most {MOST_PARAMETERS:,} are taken")
    return expected


def read_weights(path: Path, expected: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Weights from a file.

    Args:
        path: The file.
        expected: What they must be like; no memory need be behind it.

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


def _check_backbones(path: Path, metadata: BaseModel, anew: str) -> None:
    """Refuse weights that were learned by other backbones than are meant now."""
    try:
        for each in models_in(metadata):
            if isinstance(each, BackboneConfig):
                each.check_stored()
    except ValueError as error:
        raise InvalidCheckpoint(f"'{path.parent}' cannot be used: {error}; {anew}") from None


def _misfit(path: Path, difference: str) -> InvalidCheckpoint:
    return InvalidCheckpoint(f"'{path}' does not fit its own configuration: {difference}")


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        raise ValueError("a key is there twice")
    return content
