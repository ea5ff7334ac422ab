"""Open-loop replay: the demonstration that began most like this episode, played without looking.

The baseline that tells how much of a success rate is due to seeing. As a checkpoint it holds the demonstrations'
actions and their first part poses, in safetensors like every other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save_file

from juicer.episode import ACTION_SIZE, SIMULATOR
from juicer.errors import InvalidCheckpoint, InvalidObservation
from juicer.geometry import quat_to_matrix, rotation_angle
from juicer.policy.config import MOST_PARTS
from juicer.policy.refusals import refusals_as_os_errors
from juicer.policy.tasks import PART_POSES
from juicer.policy.tensor_files import opened_tensors
from juicer.text import printable

REPLAY_FILE = "replay.safetensors"
RADIAN_M = 0.05
"""Metres that a radian of rotation counts for when initial states are compared: about half a part's length."""

MOST_BYTES = 500_000_000
"""Ten thousand demonstrations of a thousand steps."""
MOST_EPISODE_STEPS = 100_000
TENSORS = {"first_poses": ("f", 2), "actions": ("f", 2), "ends": ("i", 1), "parts": ("i", 1), "steps": ("i", 0)}
"""Kind of number and dimensions of each array in the file."""


class ReplayPolicy:
    """Plays the actions of the nearest demonstration, then keeps repeating its last one.

    The whole episode is a single chunk: it is asked once, at the first step.

    Attributes:
        observations: Part poses are all that it sees.
        observes: The same in a word.
    """

    observations = (SIMULATOR["part_poses"],)
    observes = "state"

    def __init__(
        self, first_poses: NDArray[np.float32], actions: Sequence[NDArray[np.float32]], parts: Sequence[int], steps: int
    ) -> None:
        """Remember demonstrations.

        Args:
            first_poses: Part poses ``(E, 7 P)`` at their first steps, robot base frame.
            actions: Absolute actions ``(T, 10)`` of each.
            parts: Indices of the parts that matter to the task.
            steps: Length of a chunk, as long as an episode may become.
        """
        self._first_poses = first_poses
        self._actions = actions
        self._parts = list(parts)
        self._steps = steps

    @property
    def obs_horizon(self) -> int:
        """One: where the parts lie at the first step."""
        return 1

    @property
    def action_horizon(self) -> int:
        """Steps of an episode."""
        return self._steps

    def predict(
        self, observations: Mapping[str, NDArray[Any]], streams: Sequence[np.random.Generator]
    ) -> NDArray[np.float32]:
        """Actions ``(N, steps, 10)``, absolute, for episodes at their first step; no noise is drawn.

        Raises:
            InvalidObservation: If they show another number of parts than the demonstrations.
        """
        if PART_POSES not in observations:
            raise InvalidObservation(f"observations lack '{PART_POSES}', by which a demonstration to replay is chosen")
        poses = np.asarray(observations[PART_POSES])
        given, known = poses.shape[-1] // 7, self._first_poses.shape[1] // 7
        if given != known:
            raise InvalidObservation(f"the demonstrations to replay show {known} parts, the observations {given}")
        # Of one step, the axis of steps may be left out.
        last = poses if poses.ndim == 2 else poses[:, -1]
        return np.stack([self._padded(self._nearest(each)) for each in last])

    def _nearest(self, poses: NDArray[Any]) -> int:
        parts = self._parts
        known, present = self._first_poses.reshape(-1, len(poses) // 7, 7)[:, parts], poses.reshape(-1, 7)[parts]
        apart = np.linalg.norm(known[..., :3] - present[:, :3], axis=-1)
        turned = rotation_angle(quat_to_matrix(known[..., 3:]), quat_to_matrix(present[:, 3:]))
        return int(np.argmin((apart + RADIAN_M * turned).sum(axis=-1)))

    def _padded(self, index: int) -> NDArray[np.float32]:
        steps = np.minimum(np.arange(self._steps), len(self._actions[index]) - 1)
        return self._actions[index][steps]

    def save(self, folder: Path, task: str) -> None:
        """Write the policy as a checkpoint for the task that its demonstrations show."""
        tensors = {
            "first_poses": self._first_poses,
            "actions": np.concatenate(self._actions),
            "ends": np.cumsum([len(actions) for actions in self._actions]),
            "parts": np.array(self._parts),
            "steps": np.array(self._steps),
        }
        path = folder / REPLAY_FILE
        with refusals_as_os_errors(path):
            save_file(tensors, path, {"task": task})


def load_replay(path: Path, task: str, max_steps: int | None = None) -> ReplayPolicy:
    """Read what :meth:`ReplayPolicy.save` wrote.

    Args:
        path: The file.
        task: Assembly task that is to be done.
        max_steps: Steps that an episode may take, if they may be more than when the policy was saved.

    Raises:
        InvalidCheckpoint: If the file cannot be read, contradicts itself, or its demonstrations show another task.
    """
    with opened_tensors(path, "numpy", MOST_BYTES) as file:
        shown = (file.metadata() or {}).get("task")
        if shown != task:
            raise InvalidCheckpoint(f"the demonstrations to replay show '{printable(shown)}', not '{task}'")
        # A missing one is told; those that nobody asks for are not read.
        content = {name: file.get_tensor(name) for name in TENSORS}
    if problem := _problem(content):
        raise InvalidCheckpoint(f"demonstrations to replay in '{path}' cannot be used: {problem}")
    actions = np.split(content["actions"], content["ends"][:-1])
    # A second chunk would begin the demonstration anew.
    steps = max(int(content["steps"]), max_steps or 0)
    return ReplayPolicy(content["first_poses"], actions, content["parts"].tolist(), steps)


def _problem(content: Mapping[str, NDArray[Any]]) -> str | None:
    """What is wrong with the arrays of a file, if anything is."""
    for name, (kind, dimensions) in TENSORS.items():
        array = content[name]
        if array.dtype.kind != kind or array.ndim != dimensions:
            return f"'{name}' is of type {array.dtype} and shape {array.shape}"
        if not np.isfinite(array).all():
            return f"'{name}' holds numbers that are not finite"
    ends, poses, parts = content["ends"], content["first_poses"], content["parts"]
    num_parts, rest = divmod(poses.shape[1], 7)
    if not 1 <= len(ends) == len(poses) or rest or not 1 <= num_parts <= MOST_PARTS:
        return f"{len(ends)} demonstrations, but first poses of shape {poses.shape}"
    if ends.min() < 1 or np.any(np.diff(ends) <= 0) or content["actions"].shape != (ends[-1], ACTION_SIZE):
        return "its demonstrations do not end where its actions do"
    if not 1 <= len(parts) <= num_parts or len(set(parts.tolist())) < len(parts):
        return f"{len(parts)} of {num_parts} parts matter, or one of them twice"
    if parts.min() < 0 or parts.max() >= num_parts:
        return f"a part beyond the {num_parts} that there are"
    return None if 1 <= content["steps"] <= MOST_EPISODE_STEPS else f"{content['steps']} steps an episode"
