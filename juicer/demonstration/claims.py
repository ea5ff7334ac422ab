"""Whether a recording shows what it claims, asked of the simulator.

A log's arrays may be well-formed and yet belong to another task, another reset or no physics at all. Everything that a
demonstration is used for later rests on its simulator states, so they are compared with all else that the log says.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from mujoco import FatalError
from numpy.typing import NDArray

from juicer.demonstration.log import OperatorLog
from juicer.episode import SIMULATOR, STATE_KEY, Outcome
from juicer.errors import InvalidAction, InvalidEpisode, RejectedLog
from juicer.sim.env import STEP_S, AssemblyEnv
from juicer.sim.milestones import TaskProgress
from juicer.sim.sections import LARGEST_VALUE, StateSections
from juicer.tasks.registry import get_task

RESTORED_STATES = 20
"""States of a log that are restored, besides those at which something is claimed to happen."""

_TIME_S = 1e-3
_STORED = 1e-5
"""Numbers that the log holds twice may differ so much: it stores one of the two in single precision."""
_INITIAL_M = 1e-3
"""The same seed gives the same initial state, but for the arithmetic of another processor; rotations likewise."""
_LED = 1e-4
"""Relative to one and to the number itself: so much may differ where the actions of a rollout lead to (0.1 mm). The
arithmetic of another processor changed a state by 1e-9 in 356 steps, and contacts magnify it in longer rollouts."""
_SHOWN = np.array([1e-4] * 9 + [1e-2] * 6 + [1e-4])
"""Tolerance of proprioception: pose [m], velocities [m/s, rad/s], gripper [m]."""
_REPEATED_M = 5e-4
"""One step from the same state moves everything alike, but for the arithmetic of another processor."""

Observation = Mapping[str, NDArray[Any]]


def leads_to(env: AssemblyEnv, seed: int, actions: NDArray[np.generic], state: NDArray[np.float64]) -> bool:
    """Whether actions lead from the reset to a seed to a simulator state.

    Args:
        env: Environment of the scene; its state is replaced.
        seed: Initial-state seed.
        actions: What is done from there on ``(P, 10)``.
        state: State of the scene that is to be reached, of the same size as the environment's.
    """
    env.reset(seed=seed)
    for action in actions:
        try:
            env.step(action)
        except InvalidAction:
            return False
    reached = env.get_state()
    return bool(np.all(np.abs(reached - state) <= _LED * (1 + np.abs(reached))))


class ClaimChecker:
    """Compares logs of one task with what the simulator says."""

    def __init__(self, task: str) -> None:
        """Prepare the scene.

        Raises:
            ConfigError: If there is no such task.
        """
        self._task = get_task(task)
        self._envs: dict[str, AssemblyEnv] = {}
        self._progress = TaskProgress(self._task)
        env = self._env("low")
        self.state_size = len(env.get_state())
        self._bodies = [env.model.body(part.name).id for part in self._task.parts]

    def check(self, log: OperatorLog) -> None:
        """Check a log whose arrays have the shapes that the task demands, and are finite.

        Raises:
            RejectedLog: If the simulator contradicts it.
        """
        env = self._env(log.randomness)
        states = np.vstack([log.steps[STATE_KEY], log.final[STATE_KEY]]).astype(np.float64, copy=False)
        self._check_states(env, log, states)
        self._check_beginning(env, log, states[0])
        assembled = {int(pair) for pair in np.flatnonzero(StateSections.of(env, states[:1]).assembled[0])}
        rewarded = [int(step) for step in np.flatnonzero(log.steps["reward"])]
        claimed = {step + 1 for step in rewarded} | set(log.milestones.values())
        for index in sorted(claimed | set(np.linspace(0, len(log), RESTORED_STATES, dtype=int).tolist())):
            _restore(env, states[index], index)
            self._check_observation(env, log, index)
            reached = self._reached(env)
            for name, step in log.milestones.items():
                if step == index and name not in reached:
                    raise RejectedLog(
                        f"it claims milestone '{name}' after {step} steps, which that state does not show"
                    )
            if index - 1 in rewarded:
                self._check_reward(log, index - 1, reached, assembled)
        # The last of these states is the final one.
        if env.outcome is not Outcome.SUCCESS:
            raise RejectedLog(f"it claims success, but its final state is {env.outcome or 'in mid-assembly'}")
        pairs = len(self._task.pairs)
        if len(assembled) < pairs:
            raise RejectedLog(f"it claims success, but only {len(assembled)} of the task's {pairs} pairs are assembled")
        self._check_physics(env, log, states, rewarded)

    def _env(self, randomness: str) -> AssemblyEnv:
        if randomness not in self._envs:
            self._envs[randomness] = AssemblyEnv(self._task.name, randomness)
        return self._envs[randomness]

    def _check_states(self, env: AssemblyEnv, log: OperatorLog, states: NDArray[np.float64]) -> None:
        """What can be seen of every state without restoring it."""
        sections = StateSections.of(env, states)
        steps = log.first_step + np.arange(len(states))
        shown = {name: np.vstack([log.steps[name], log.final[name]]) for name in ("proprioception", "part_poses")}
        before = 0 if log.parent is None else sections.assembled[0].sum()
        counted = before + np.concatenate([[0], np.cumsum(log.steps["reward"])])
        wrong = {
            "holds values beyond all that a simulation has": (np.abs(states) > LARGEST_VALUE).any(axis=1),
            "is not of the moment of its step; record every step, from the reset on": (
                np.abs(sections.time_s - STEP_S * steps) > _TIME_S
            )
            | (sections.num_steps != steps),
            "has sleeping bodies that no scene has": ~sections.has_rings(),
            "has its parts elsewhere than the recorded part poses": _differ(sections.part_poses, shown["part_poses"]),
            "has another gripper width than the recorded proprioception": _differ(
                sections.gripper_width_m[:, None], shown["proprioception"][:, -1:]
            ),
            "counts other assembled pairs than the rewards before it": sections.assembled.sum(axis=1) != counted,
        }
        for fault, where in wrong.items():
            if where.any():
                raise RejectedLog(f"the simulator state of step {int(np.argmax(where))} {fault}")

    def _check_beginning(self, env: AssemblyEnv, log: OperatorLog, state: NDArray[np.float64]) -> None:
        """Whether a log begins at the reset to its seed, or where the actions of its rollout lead from there."""
        if log.parent is not None:
            if not leads_to(env, log.seed, log.parent_actions, state):
                raise RejectedLog(
                    f"the {log.first_step} actions of its rollout do not lead from a reset to seed {log.seed} at "
                    f"{log.randomness} randomness to its first state; the log is damaged, or was recorded by another "
                    "version of the simulator"
                )
            return
        env.reset(seed=log.seed)
        expected = StateSections.of(env, env.get_state()[None])
        found = StateSections.of(env, state[None])
        end_effector = _distance(env.observation()["proprioception"][:9], log.steps["proprioception"][0, :9])
        if max(_distance(expected.part_poses, found.part_poses), end_effector) > _INITIAL_M:
            raise RejectedLog(
                f"its first state is not the one that a reset to seed {log.seed} at {log.randomness} randomness gives"
            )

    def _check_observation(self, env: AssemblyEnv, log: OperatorLog, index: int) -> None:
        shown = env.observation()["proprioception"].astype(np.float64)
        recorded: NDArray[Any] = (log.final if index == len(log) else _at(log.steps, index))["proprioception"]
        if not np.all(np.abs(shown - recorded) <= _SHOWN):
            raise RejectedLog(f"the recorded proprioception of step {index} is not what its simulator state shows")

    def _reached(self, env: AssemblyEnv) -> set[str]:
        """Milestones whose condition holds in the environment's present state."""
        return self._progress.reached(env.data.xpos[self._bodies], env.data.xmat[self._bodies].reshape(-1, 3, 3))

    def _check_reward(self, log: OperatorLog, step: int, reached: set[str], assembled: set[int]) -> None:
        """Add the pairs that a step assembled to those before it, and compare their number with its reward."""
        before = set(assembled)
        for index, pair in enumerate(self._task.pairs):
            if pair.milestones[-1] in reached and assembled.issuperset(pair.after):
                assembled.add(index)
        found, reward = len(assembled - before), float(log.steps["reward"][step])
        if found != reward:
            raise RejectedLog(f"step {step} has the reward {reward:g}, but {found} pairs are newly assembled after it")

    def _check_physics(
        self, env: AssemblyEnv, log: OperatorLog, states: NDArray[np.float64], rewarded: list[int]
    ) -> None:
        """Execute a few steps again: those that assembled something, and the one whose target leaps farthest."""
        leaps = np.abs(np.diff(log.steps["action"][:, :3].astype(np.float64), axis=0)).sum(axis=1)
        farthest = int(np.argmax(leaps)) + 1 if len(leaps) else 0
        after = StateSections.of(env, states)
        for step in sorted({*rewarded, farthest}):
            _restore(env, states[step], step)
            env.step(log.steps["action"][step])
            observation = env.observation()
            recorded = log.final if step + 1 == len(log) else _at(log.steps, step + 1)
            moved = _distance(observation["proprioception"][:3], recorded["proprioception"][:3])
            shifted = _distance(observation["part_poses"], after.part_poses[step + 1])
            if not max(moved, shifted) <= _REPEATED_M:
                raise RejectedLog(
                    f"the action of step {step} does not lead from its simulator state to the next; an action belongs "
                    "to the state and observation before it, and recordings of another version have other physics"
                )


def _restore(env: AssemblyEnv, state: NDArray[np.float64], index: int) -> None:
    try:
        env.set_state(state)
    except (InvalidEpisode, FatalError):
        raise RejectedLog(f"the simulator state of step {index} cannot be restored") from None


def _at(steps: Observation, index: int) -> Observation:
    return {name: steps[name][index] for name in SIMULATOR.ends}


def _distance(first: NDArray[Any], second: NDArray[Any]) -> float:
    """Largest difference of two entries; not a number if one of them is none."""
    return float(np.abs(first.astype(np.float64) - second).max())


def _differ(stored: NDArray[np.float64], shown: NDArray[Any]) -> NDArray[np.bool_]:
    differs: NDArray[np.bool_] = np.any(np.abs(stored - shown) > _STORED, axis=1)
    return differs
