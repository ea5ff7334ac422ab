"""The full restorable state of a scene as one vector of float64.

MuJoCo's integration state lacks one thing that decides the future here: which bodies sleep and how long the others
have been at rest. Both are appended, followed by the environment's own progress.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.errors import InvalidEpisode

DIVERGED_SPEED = 200.0
"""Norm of all joint velocities from which on a simulation counts as diverged [m/s and rad/s together]."""

AWAKE_COUNTS = ("ntree_awake", "nbody_awake", "nparent_awake", "nv_awake")
"""Lengths of the lists that MuJoCo derives from the sleep counters."""

SHIFT_MARKS = 2
"""Numbers that follow in a state of an environment under a shift, see :mod:`juicer.sim.shifting`."""

_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
# A tree that has just been touched stays awake for so many steps.
_JUST_WOKEN = -(1 + mujoco.mjMINAWAKE)
_NEVER_SLEEP = (int(mujoco.mjtSleepPolicy.mjSLEEP_NEVER), int(mujoco.mjtSleepPolicy.mjSLEEP_AUTO_NEVER))

_FARTHEST = 1e4  # metres or radians: nothing thrown at less than the speed of a divergence comes that far
_LARGEST = 1e9  # forces and accelerations; those of the hardest collisions are four orders smaller
_UNIT_TOLERANCE = 1e-3

Array = NDArray[np.float64]


class SimulatorState:
    """Reads and writes the state vector ``[integration, sleep, progress]`` of one model.

    Progress is ``[steps taken, whether each pair is assembled, first step of each milestone or -1]``.
    """

    def __init__(self, model: mujoco.MjModel, num_pairs: int, num_milestones: int) -> None:
        """Lay out the vector for ``model`` and a task of so many pairs and milestones."""
        self._model = model
        self._num_pairs = num_pairs
        self._integration_size = mujoco.mj_stateSize(model, _INTEGRATION)
        self._sections = [self._integration_size, self._integration_size + model.ntree]
        self.size = self._sections[-1] + 1 + num_pairs + num_milestones
        self._positions = self._span(mujoco.mjtState.mjSTATE_QPOS)
        self._velocities = self._span(mujoco.mjtState.mjSTATE_QVEL)
        self._switches = self._span(mujoco.mjtState.mjSTATE_EQ_ACTIVE)
        free = model.jnt_qposadr[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
        self._quaternions = free[:, None] + np.arange(3, 7)
        self._sleepless = np.isin(model.tree_sleep_policy, _NEVER_SLEEP)

    def read(self, data: mujoco.MjData, progress: Array) -> Array:
        """State vector ``(size,)``."""
        integration = np.empty(self._integration_size)
        mujoco.mj_getState(self._model, data, integration, _INTEGRATION)
        return np.concatenate([integration, data.tree_asleep, progress])

    def write(self, data: mujoco.MjData, progress: Array, state: Array) -> None:
        """Make ``data`` and ``progress`` continue exactly from a state vector.

        Raises:
            InvalidEpisode: If it cannot be a state of this scene, or is one that diverged; nothing has changed.
        """
        state = self._checked(state)
        before = self.read(data, progress)
        try:
            self._write(data, progress, state)
        except mujoco.FatalError as error:
            self._write(data, progress, before)
            raise InvalidEpisode(f"MuJoCo cannot go on from this simulator state: {error}") from None

    def _write(self, data: mujoco.MjData, progress: Array, state: Array) -> None:
        integration, asleep, kept = np.split(state, self._sections)
        # Reset wakes every body, so that the derived positions of those about to sleep are computed afresh.
        mujoco.mj_resetData(self._model, data)
        mujoco.mj_setState(self._model, data, integration, _INTEGRATION)
        mujoco.mj_forward(self._model, data)
        mujoco.mj_setState(self._model, data, integration, _INTEGRATION)
        self._put_to_sleep(data, asleep.astype(np.int32))
        progress[:] = kept

    def _put_to_sleep(self, data: mujoco.MjData, asleep: NDArray[np.int32]) -> None:
        """Set the sleep counters and the lists MuJoCo derives from them, for which it offers no function."""
        model = self._model
        data.tree_asleep[:] = asleep
        awake = asleep < 0
        data.tree_awake[:] = awake
        data.ntree_awake = int(awake.sum())
        moving = model.body_treeid >= 0
        data.body_awake[moving] = awake[model.body_treeid[moving]]
        bodies = np.flatnonzero(data.body_awake != 0)
        data.nbody_awake = len(bodies)
        data.body_awake_ind[: len(bodies)] = bodies
        dofs = np.flatnonzero(awake[model.dof_treeid])
        data.nv_awake = len(dofs)
        data.dof_awake_ind[: len(dofs)] = dofs

    def _span(self, part: mujoco.mjtState) -> slice:
        """Where a part of the integration state stands: the parts follow each other in the order of their bits."""
        start = mujoco.mj_stateSize(self._model, _INTEGRATION & (int(part) - 1))
        return slice(start, start + mujoco.mj_stateSize(self._model, int(part)))

    def _checked(self, state: Array) -> Array:
        try:
            values = np.asarray(state)
        except ValueError:  # a ragged list
            values = np.empty(0)
        if values.shape != (self.size,) or values.dtype != np.float64:
            got = f"{values.dtype} {values.shape}" if isinstance(state, np.ndarray) else type(state).__name__
            is_marked = values.shape == (self.size + SHIFT_MARKS,)
            hint = ": it is of an environment under a shift, and goes on only there" if is_marked else ""
            raise InvalidEpisode(f"a simulator state of this scene has {self.size} entries of float64, got {got}{hint}")
        if not np.isfinite(values).all():
            raise InvalidEpisode("the simulator state holds NaN or infinite values: the simulation had diverged there")
        for problem in (
            self._problem_of_motion(values),
            self._problem_of_sleep(values),
            self._problem_of_progress(values),
        ):
            if problem:
                raise InvalidEpisode(f"this is not a simulator state of this scene: {problem}")
        return values

    def _problem_of_motion(self, state: Array) -> str | None:
        integration = state[: self._integration_size]
        positions = integration[self._positions]
        if np.abs(positions).max() > _FARTHEST:
            return f"a position is {np.abs(positions).max():.3g}"
        if (speed := mujoco.mju_norm(integration[self._velocities])) >= DIVERGED_SPEED:
            return f"its speed is {speed:.3g}, and from {DIVERGED_SPEED:g} on the simulation has diverged"
        if np.abs(integration).max() > _LARGEST:
            return f"a force, an acceleration or the time is {np.abs(integration).max():.3g}"
        norms = np.linalg.norm(positions[self._quaternions], axis=-1)
        if np.abs(norms - 1).max() > _UNIT_TOLERANCE:
            return "the quaternion of a part is not of unit length"
        if not np.isin(integration[self._switches], (0, 1)).all():
            return "whether a constraint is active is neither 0 nor 1"
        return None

    def _problem_of_sleep(self, state: Array) -> str | None:
        asleep = state[slice(*self._sections)]
        sleeping = np.flatnonzero(asleep >= 0)
        # Sleeping trees name each other in closed cycles. MuJoCo follows them without looking.
        if not np.array_equal(np.sort(asleep[sleeping]), sleeping):
            return "the trees that sleep do not name each other in cycles"
        if self._sleepless[sleeping].any():
            return "the robot sleeps"
        awake = asleep[asleep < 0]
        if np.any((awake < _JUST_WOKEN) | (awake != np.round(awake))):
            return f"a sleep counter lies outside {_JUST_WOKEN} to {self._model.ntree - 1}"
        return None

    def _problem_of_progress(self, state: Array) -> str | None:
        steps, *_ = progress = state[self._sections[-1] :]
        if not 0 <= steps <= _LARGEST or np.any(progress != np.round(progress)):
            return "its progress is not counted in whole steps"
        assembled, first_steps = progress[1 : 1 + self._num_pairs], progress[1 + self._num_pairs :]
        if np.any((assembled < 0) | (assembled > 1)):
            return "whether a pair is assembled is neither 0 nor 1"
        if np.any((first_steps < -1) | (first_steps > steps)):
            return "a milestone was reached before the first or after the last step"
        return None
