"""A checkpoint as MLflow's model: ``mlflow.pyfunc.load_model`` calls :func:`_load_pyfunc`, and nothing is unpickled.

MLflow is not imported here: all it asks of a module is this function.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.policy.acting import TrainedPolicy
from juicer.policy.checkpoint import load_policy
from juicer.policy.replay import ReplayPolicy
from juicer.seeding import stream

TASK = "task"
"""Key of a model's configuration: the task it acts on."""


class ServedPolicy:
    """A policy that chooses actions for many episodes at a time; the same calls get the same actions."""

    def __init__(self, policy: TrainedPolicy | ReplayPolicy) -> None:
        self._policy = policy
        self._streams: list[np.random.Generator] = []

    def predict(self, model_input: Mapping[str, Any]) -> NDArray[np.float32]:
        """Next actions of N episodes.

        Args:
            model_input: What the policy observes: ``proprioception`` ``(N, 16)``, and ``part_poses`` ``(N, 7 P)`` or
                images ``(N, h, w, 3)`` by the names of their views. A mapping, or a DataFrame with a row an episode and
                an array in each cell. With ``T_o`` above one, the last ``T_o`` of them.

        Returns:
            Absolute actions ``(N, T_a, 10)``, robot base frame.

        Raises:
            InvalidObservation: If an array is missing or has another shape.
        """
        rows = {name: _array(values) for name, values in model_input.items()}
        num_rows = max(map(len, rows.values()), default=0)
        self._streams += [stream(0, "served policy", row) for row in range(len(self._streams), num_rows)]
        return self._policy.predict(rows, self._streams[:num_rows])


def _array(values: Any) -> NDArray[Any]:
    """Numbers in single precision; whole ones that may be pixels, which JSON does not tell from others, as bytes."""
    array = np.asarray(list(values))
    if array.dtype.kind not in "iu":
        return array.astype(np.float32)
    may_be_pixels = array.size > 0 and array.min() >= 0 and array.max() <= np.iinfo(np.uint8).max
    return array.astype(np.uint8 if may_be_pixels else np.float32)


def _load_pyfunc(path: str, model_config: Mapping[str, Any]) -> ServedPolicy:
    return ServedPolicy(load_policy(Path(path), model_config[TASK]))
