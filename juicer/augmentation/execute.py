"""Carry a departure out and come back: the only part of the augmentation that steps the simulator."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.augmentation.plan import POSE_SIZE, reverse
from juicer.augmentation.reference import Reference
from juicer.augmentation.verify import RejectionReason, outcome_rejection
from juicer.episode import Episode, EpisodeRecord, Outcome, Source
from juicer.sim.env import AssemblyEnv
from juicer.sim.recorder import EpisodeRecorder


def execute(env: AssemblyEnv, reference: Reference, departure: NDArray[np.float64]) -> Episode | RejectionReason:
    """Restore the critical state, depart, and record the return and the demonstration's own actions after it.

    The way back is the departure's *achieved* poses, reversed, as absolute targets: where the end effector has been, it
    can be again. The departure itself is not recorded.

    Args:
        env: Any environment of the reference's task; left wherever the snippet ends.
        reference: What the demonstration did from the critical state on.
        departure: Poses to leave by ``(K, 9)``, see :func:`juicer.augmentation.plan.plan_departure`.

    Returns:
        The snippet, not yet compared with the demonstration, or why there is none.
    """
    # Restoring is exact, controller included, so the first step after it is the demonstration's own. Isaac Gym
    # restores positions only; the paper therefore restores and holds ten times until the scene settles.
    env.set_state(reference.state)
    held = held_parts(env)
    achieved = [reference.pose]
    for target in departure:
        observation, *_, info = env.step(_action(target, reference.gripper))
        if info["outcome"] is not None:
            return outcome_rejection(info["outcome"])
        achieved.append(observation["proprioception"][:POSE_SIZE])
    if not held <= held_parts(env):
        return RejectionReason.DROPPED

    recorder = EpisodeRecorder(env)
    back = [_action(pose, reference.gripper) for pose in reverse(np.array(achieved))]
    for action in (*back, *reference.actions):
        recorder.step(action)
        if recorder.info["outcome"] not in (None, Outcome.SUCCESS):
            return outcome_rejection(recorder.info["outcome"])
    return recorder.episode(
        EpisodeRecord(
            source=Source.AUGMENTATION,
            task=reference.task,
            randomness=reference.randomness,
            seed=reference.seed,
            outcome=Outcome.SUCCESS,
            parts_assembled=int(recorder.info["parts_assembled"]),
            parent=reference.parent,
            critical_state=reference.critical_state,
        )
    )


def reproduces(env: AssemblyEnv, snippet: Episode) -> bool:
    """Whether the snippet's stored actions, from its first stored state, end in exactly its final state."""
    env.set_state(snippet.state(0))
    for action in snippet.steps["action"]:
        env.step(action)
    return np.array_equal(env.get_state(), snippet.state(len(snippet)))


def _action(pose: NDArray[np.floating[Any]], gripper: float) -> NDArray[np.float32]:
    return np.append(pose, gripper).astype(np.float32)


def held_parts(env: AssemblyEnv) -> set[str]:
    """Parts that touch the gripper."""
    return {
        part.name for part in env.task.parts if any({"gripper", part.name} == set(pair) for pair in env.contact_pairs())
    }
