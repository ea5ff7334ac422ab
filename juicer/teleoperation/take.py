"""The episode in hand: recorded step by step, and taken back step by step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.demonstration.log import OperatorLog
from juicer.episode import ACTION_SIZE, STATE_KEY, EpisodeRecord, Outcome, Source
from juicer.sim.env import STEP_S, AssemblyEnv
from juicer.sim.panda import NUM_ARM_JOINTS
from juicer.sim.recorder import EpisodeRecorder
from juicer.sim.sections import StateSections
from juicer.teleoperation.drivers import Driver, devices_of, operators_of
from juicer.teleoperation.origin import Origin


class Take(EpisodeRecorder):
    """Records an environment from a reset on, idle steps too, as operator logs demand.

    Attributes:
        seed: Initial-state seed that the environment was reset to.
        idle: Whether the operator commanded nothing, a step.
        assembled_before: Pairs that were assembled where it begins.
        began_closed: Whether the gripper had been told to close where it begins.
        began: When its first step was made, in ISO 8601; empty before that.
        drivers: Who made its steps, and how, in their order.
    """

    def __init__(self, env: AssemblyEnv, seed: int, state: NDArray[np.float64] | None = None) -> None:
        """Reset the environment to a seed and record from there, or from another state.

        Raises:
            InvalidEpisode: If the state is none of this scene.
        """
        env.reset(seed=seed)
        if state is not None:
            env.set_state(state)
        super().__init__(env)
        self.seed = seed
        self.idle: list[bool] = []
        self.assembled_before = int(StateSections.of(env, self.state[None]).assembled.sum())
        self.began_closed = bool(env.data.ctrl[NUM_ARM_JOINTS] < 0)
        self.began = ""
        self.drivers: list[Driver] = []
        self._infos: list[Mapping[str, Any]] = []
        self._left = self.state

    def act(self, action: NDArray[Any], *, idle: bool) -> None:
        """Record the present observation and simulator state with the action, then execute it.

        Raises:
            InvalidAction: If the environment refuses the action; nothing is recorded.
        """
        self.step(action)
        self.idle.append(idle)
        self._infos.append(self.info)

    def undo(self, steps: int) -> int:
        """Take the last steps back: the simulator is in the state before them, bit for bit.

        Returns:
            Steps that were taken back; fewer if there were not so many.
        """
        steps = min(steps, len(self))
        if not steps:
            return 0
        kept = len(self) - steps
        self._env.set_state(np.asarray(self._steps[STATE_KEY][kept]))
        for values in self._steps.values():
            del values[kept:]
        del self.idle[kept:], self._infos[kept:]
        self.observation, self.done = self._env.observation(), False
        self.info = self._infos[-1] if self._infos else {}
        return steps

    def leave(self) -> None:
        """Another episode gets the environment; :meth:`come_back` goes on with this one."""
        self._left = self.state

    def come_back(self) -> None:
        """Go on where it was left, bit for bit.

        Raises:
            InvalidEpisode: If the simulation had diverged then.
        """
        self._env.set_state(self._left)

    @property
    def state(self) -> NDArray[np.float64]:
        """The simulator's present state."""
        return self._env.get_state()

    @property
    def last_step(self) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Simulator state before the last action, and that action."""
        return np.asarray(self._steps[STATE_KEY][-1], np.float64), np.asarray(self._steps["action"][-1], np.float32)

    @property
    def actions(self) -> NDArray[np.float32]:
        """Actions so far ``(T, 10)``."""
        return np.asarray(self._steps["action"], np.float32).reshape(-1, ACTION_SIZE)

    @property
    def outcome(self) -> Outcome | None:
        """How the episode has ended; None as long as it goes on."""
        return self.info.get("outcome")

    def log(self, ended: str, origin: Origin | None = None) -> OperatorLog:
        """What was recorded so far, as a log.

        Timestamps count simulated time: steps that were taken back, pauses and a slower time scale leave no gaps.

        Args:
            ended: When the last step was made, in ISO 8601.
            origin: The step of a rollout from which it goes, if it goes from one.

        Raises:
            InvalidEpisode: If nothing was recorded, or the simulation has diverged.
        """
        first = origin.step if origin else 0
        record = EpisodeRecord(
            source=Source.CORRECTION if origin else Source.TELEOP,
            task=self._env.task.name,
            randomness=str(self._env.randomness),
            seed=self.seed,
            outcome=self.info["outcome"] or Outcome.TIMEOUT,
            parts_assembled=self.info["parts_assembled"],
            milestones={name: step - first for name, step in self.info["milestones"].items() if step >= first},
            parent=origin.parent if origin else None,
            parent_step=origin.step if origin else None,
            device=devices_of(self.drivers),
            operator=operators_of(self.drivers) or None,
            recorded_at=f"{self.began}/{ended}",
        )
        timestamp_s = np.arange(len(self), dtype=np.float64) * STEP_S
        led = origin.actions if origin else None
        return OperatorLog.of(self.episode(record), timestamp_s, np.array(self.idle), led)
