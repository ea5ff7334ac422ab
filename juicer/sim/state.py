"""The full restorable state of a scene as one vector of float64.

MuJoCo's integration state lacks one thing that decides the future here: which bodies sleep and how long the others
have been at rest. Both are appended, followed by the environment's own progress.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.errors import InvalidEpisode

_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)


class SimulatorState:
    """Reads and writes the state vector ``[integration, sleep, progress]`` of one model."""

    def __init__(self, model: mujoco.MjModel, progress_size: int) -> None:
        """Lay out the vector for ``model`` and a progress vector of ``progress_size`` entries."""
        self._model = model
        self._integration_size = mujoco.mj_stateSize(model, _INTEGRATION)
        self.size = self._integration_size + model.ntree + progress_size

    def read(self, data: mujoco.MjData, progress: NDArray[np.float64]) -> NDArray[np.float64]:
        """State vector ``(size,)``."""
        integration = np.empty(self._integration_size)
        mujoco.mj_getState(self._model, data, integration, _INTEGRATION)
        return np.concatenate([integration, data.tree_asleep, progress])

    def write(self, data: mujoco.MjData, progress: NDArray[np.float64], state: NDArray[np.float64]) -> None:
        """Make ``data`` and ``progress`` continue exactly from a state vector.

        Raises:
            InvalidEpisode: If the vector has another length: it belongs to another scene.
        """
        if np.shape(state) != (self.size,):
            raise InvalidEpisode(f"a simulator state of this scene has {self.size} entries, got {np.shape(state)}")
        sections = [self._integration_size, self._integration_size + self._model.ntree]
        integration, asleep, kept = np.split(state, sections)
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
