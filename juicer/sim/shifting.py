"""What a shift changes in the physics of an environment, beside where parts start: how things rub, and a push.

MuJoCo's own state holds the force of a push while it lasts. Which push is to come is decided by the episode's key, so
the states of an environment under a shift end in two numbers more: by which the shift is known, and the key. Only an
environment under the same shift goes on from them.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.config import canonical_json
from juicer.errors import ConfigError, InvalidEpisode
from juicer.shifts import KEYS, Friction, Push, Shift, ShiftOfEpisode
from juicer.sim.panda import FINGER_BODIES
from juicer.sim.state import SHIFT_MARKS
from juicer.tasks.specification import AssemblyTask, Randomness


def shift_model(model: mujoco.MjModel, shift: Shift | None, randomness: Randomness) -> ShiftOfEpisode | None:
    """Change in a model what a shift changes for good, how things rub; the shift before the first episode.

    Raises:
        ConfigError: If there is no such shift from that randomness.
    """
    if shift is None:
        return None
    try:
        shift.check(randomness)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    if isinstance(shift, Friction):
        model.geom_friction *= shift.factor
    return ShiftOfEpisode.of(shift, 0)


def push(episode: ShiftOfEpisode, task: AssemblyTask, data: mujoco.MjData, step: int, step_s: float) -> None:
    """Begin or end the episode's push, if there is one and this is the step for it.

    Args:
        episode: The shift, and what the episode makes of it.
        task: Whose parts lie there.
        data: State of the scene; ``xfrc_applied`` is changed.
        step: Steps since the reset.
        step_s: Length of a step [s].
    """
    if not isinstance(own := episode.shift, Push):
        return
    rng = episode.stream("push")
    first = int(rng.integers(round(own.earliest * task.max_steps), round(own.latest * task.max_steps) + 1))
    if step == first + own.steps:
        data.xfrc_applied[:] = 0
    if step == first:
        angle, part = rng.uniform(0, 2 * math.pi), int(rng.choice(task.assembled_parts))
        body, force = data.model.body(task.parts[part].name).id, task.parts[part].mass * own.speed_m_s
        force /= own.steps * step_s
        if held := _held(task, data):
            body, force = held, own.force_n
        data.xfrc_applied[body, :2] = force * math.cos(angle), force * math.sin(angle)


def _held(task: AssemblyTask, data: mujoco.MjData) -> int | None:
    """Body of the part that both fingers touch; by the positions alone, so that a restored state decides alike."""
    model, still = data.model, mujoco.MjData(data.model)
    still.qpos[:] = data.qpos
    mujoco.mj_fwdPosition(model, still)
    pairs = {frozenset(pair) for pair in model.geom_bodyid[still.contact.geom[still.contact.dist <= 0]].tolist()}
    fingers = [model.body(name).id for name in FINGER_BODIES]
    bodies = [model.body(part.name).id for part in task.parts]
    return next((body for body in bodies if all(frozenset((body, finger)) in pairs for finger in fingers)), None)


def marked(state: NDArray[np.float64], episode: ShiftOfEpisode | None) -> NDArray[np.float64]:
    """State of an environment from that of its scene; the same without a shift."""
    return state if episode is None else np.concatenate([state, [episode.fingerprint, episode.key]])


def unmarked(
    state: NDArray[np.float64], present: ShiftOfEpisode | None
) -> tuple[NDArray[np.float64], ShiftOfEpisode | None]:
    """State of a scene from that of an environment, and what its episode makes of the shift.

    Args:
        state: The environment's.
        present: The shift that the environment is under, whatever its episode.

    Raises:
        InvalidEpisode: If the state is of no environment under this shift.
    """
    if present is None:
        return state, None
    is_vector = isinstance(state, np.ndarray) and state.dtype == np.float64 and state.ndim == 1
    if is_vector and len(state) > SHIFT_MARKS:
        fingerprint, key = state[-SHIFT_MARKS:].tolist()
        if fingerprint == present.fingerprint and 0 <= key < KEYS and key == int(key):
            return state[:-SHIFT_MARKS], ShiftOfEpisode(present.shift, int(key))
    raise InvalidEpisode(
        f"this is no simulator state of an environment under the shift {canonical_json(present.shift)}; restore it in "
        "one that is made with the shift in the record of its episode"
    )
