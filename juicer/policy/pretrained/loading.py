"""Weights from files into networks: only tensors, only whole, and only into the network they belong to."""

from __future__ import annotations

import io
import json
import logging
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import torch
from safetensors.torch import load as load_safetensors
from torch import Tensor, nn

from juicer.errors import UnusableWeights
from juicer.policy.backbone import Backbone
from juicer.policy.model_files import POSES_TAUGHT
from juicer.policy.pretrained.config import Weights
from juicer.policy.pretrained.files import read_weights_file
from juicer.text import printable

WRAPPERS = ("r3m", "vip", "model", "state_dict")
"""Under which name files hold their weights beside other things."""
PREFIXES = ("module.", "convnet.")
"""What the names of weights begin with that were saved as a part of something."""
SAFETENSORS = ".safetensors"
_OF_TORCH = (b"PK", b"\x80")
"""What files of torch begin with: archives, or pickles as it wrote them long ago."""
_LENGTH_BYTES = 8
"""Length of a safetensors file's header, in front of it."""

logger = logging.getLogger(__name__)


class Pretrained(NamedTuple):
    """What a network started from.

    Attributes:
        weights: The file.
        poses_taught: Whether true poses of parts taught some of it to read images, as the file itself says.
    """

    weights: Weights
    poses_taught: bool


def load_pretrained(network: nn.Module, folder: Path) -> tuple[Pretrained, ...]:
    """Fill every backbone of a network that is to start from pretrained weights.

    Args:
        network: A network with backbones somewhere in it.
        folder: Where files of weights are looked for first.

    Returns:
        What was taken, each once.

    Raises:
        UnusableWeights: If a file is missing, is another one than meant, or holds something else than the weights of
            that backbone.
    """
    tensors: dict[Weights, dict[str, Tensor]] = {}
    taken = []
    for backbone in network.modules():
        if not isinstance(backbone, Backbone) or (weights := backbone.config.weights) is None:
            continue
        if weights not in tensors:
            content = read_weights_file(weights, folder)
            tensors[weights] = read_tensors(weights, content)
            taken.append(Pretrained(weights, _poses_taught(weights.file, content)))
        _fill(backbone, tensors[weights], weights.file)
    for weights in tensors:
        if not weights.is_commercial:
            logger.warning("the weights '%s' may not be used commercially: %s", weights.file, weights.licence)
    return tuple(taken)


def read_tensors(weights: Weights, content: bytes) -> dict[str, Tensor]:
    """Tensors by name in the content of a file, without what others have put around them.

    Raises:
        UnusableWeights: See :func:`load_pretrained`.
    """
    found = _unpacked(content, weights.file)
    wrapped = next((found[name] for name in WRAPPERS if isinstance(found.get(name), Mapping)), found)
    named = {str(name): value for name, value in wrapped.items() if isinstance(value, Tensor)}
    if not named or len(named) < len(wrapped):
        raise UnusableWeights(f"'{weights.file}' holds something else than tensors by name")
    chosen = {name.removeprefix(weights.part): named[name] for name in named if name.startswith(weights.part)}
    return {_without_prefixes(name): value for name, value in chosen.items()}


def _unpacked(content: bytes, file: str) -> Mapping[str, Any]:
    is_safe = file.endswith(SAFETENSORS)
    if not is_safe and not content.startswith(_OF_TORCH):
        raise UnusableWeights(f"'{file}' cannot be read as weights: it is not a file that torch wrote")
    try:
        if is_safe:
            return load_safetensors(content)
        found = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except pickle.UnpicklingError:
        raise UnusableWeights(
            f"'{file}' is a pickle that holds more than tensors, and opening it would run code of whoever wrote it; if "
            "you trust it, convert it in a process of its own: load it with torch, save the tensors with "
            "safetensors.torch.save_file, and name that file and its SHA-256"
        ) from None
    # Of what is damaged, the readers fail in every way there is.
    except Exception as error:
        raise UnusableWeights(f"'{file}' cannot be read as weights: {printable(error)}") from None
    if not isinstance(found, Mapping):
        raise UnusableWeights(f"'{file}' holds something else than tensors by name")
    return found


def _poses_taught(file: str, content: bytes) -> bool:
    """What a file that could be read as safetensors says of how it was taught."""
    if not file.endswith(SAFETENSORS):
        return False
    header = json.loads(content[_LENGTH_BYTES : _LENGTH_BYTES + int.from_bytes(content[:_LENGTH_BYTES], "little")])
    return POSES_TAUGHT.items() <= (header.get("__metadata__") or {}).items()


def _without_prefixes(name: str) -> str:
    for prefix in PREFIXES:
        name = name.removeprefix(prefix)
    return name


def _fill(backbone: Backbone, tensors: Mapping[str, Tensor], file: str) -> None:
    own, given = backbone.state_dict(), backbone.adapted(tensors)
    differences = [
        *_difference("are missing", own.keys() - given.keys()),
        *_difference("belong elsewhere", given.keys() - own.keys()),
        *_difference(
            "have another shape", {name for name in own.keys() & given.keys() if own[name].shape != given[name].shape}
        ),
    ]
    if differences:
        raise UnusableWeights(
            f"'{file}' holds the weights of another network than {backbone.config.described()}: "
            f"{', '.join(differences)}"
        )
    if broken := next((name for name in given if not bool(given[name].isfinite().all())), None):
        raise UnusableWeights(f"'{file}' cannot be used: '{printable(broken)}' holds numbers that are not finite")
    backbone.load_state_dict(given)


def _difference(what: str, names: set[str]) -> list[str]:
    return [f"{len(names)} {what} (e.g. '{printable(min(names))}')"] if names else []
