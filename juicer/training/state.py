"""The state of an unfinished training, in one file that is replaced whole: a kill leaves the old one or the new one."""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from juicer.config import canonical_json
from juicer.policy.refusals import refusals_as_os_errors
from juicer.training.windows import TrainingEpisodes

STATE_FILE = "training_state.safetensors"
IMAGES_HASHED = 64

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrainingState:
    """All that a training carries from one step to the next; its randomness is a function of seed and step.

    Attributes:
        identity: What is being trained; see :func:`training_identity`.
        step: Steps taken.
        tensors: Weights, moving average, optimiser moments and running sums by name.
    """

    identity: str
    step: int
    tensors: Mapping[str, Tensor]


def training_identity(episodes: TrainingEpisodes, settings: Mapping[str, object]) -> str:
    """Digest of data and settings, which keeps a state from being continued as something else.

    Of images, a few stand for all.
    """
    digest = hashlib.sha256(canonical_json(settings).encode())
    for name in sorted(episodes.observations):
        values = episodes.observations[name]
        every = max(1, len(values) // IMAGES_HASHED) if values.ndim > 2 else 1
        digest.update(np.ascontiguousarray(values[::every]).data)
    digest.update(np.ascontiguousarray(episodes.actions).data)
    digest.update(np.ascontiguousarray(episodes.episode_ends).data)
    digest.update("\n".join(episodes.families).encode())
    digest.update(canonical_json({"weights": list(episodes.weights)}).encode())
    return digest.hexdigest()


def save_state(folder: Path, state: TrainingState) -> None:
    """Replace the state in ``folder``, which is made if it does not exist.

    Raises:
        OSError: If the system refuses the write; the state before it stays.
    """
    folder.mkdir(parents=True, exist_ok=True)
    draft = folder / f"{STATE_FILE}.draft"
    facts = {"identity": state.identity, "step": state.step}
    try:
        with refusals_as_os_errors(draft):
            save_file(dict(state.tensors), draft, metadata={"state": json.dumps(facts)})
        with draft.open("rb") as file:
            os.fsync(file.fileno())
        draft.replace(folder / STATE_FILE)
    except OSError:
        # On a full disk, half a state would only be in the way.
        draft.unlink(missing_ok=True)
        raise


def load_state(folder: Path, identity: str) -> TrainingState | None:
    """The state to continue from, or None; one that is damaged or of another training is passed over with a warning."""
    path = folder / STATE_FILE
    if not path.exists():
        return None
    try:
        with safe_open(path, framework="pt") as file:
            facts = json.loads((file.metadata() or {})["state"])
            tensors: dict[str, torch.Tensor] = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError, KeyError, ValueError) as error:
        logger.warning("training starts afresh: the state '%s' cannot be read: %s", path, error)
        return None
    if facts["identity"] != identity:
        logger.warning("training starts afresh: the state '%s' is of other data or settings", path)
        return None
    return TrainingState(identity=identity, step=facts["step"], tensors=tensors)
