"""What every test may use, and the quiet, offline surroundings they all run in."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

# Set before anything imports these libraries: they read their settings once.
for _name, _value in {
    "OMP_NUM_THREADS": "1",
    "DO_NOT_TRACK": "1",
    "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
    "PREFECT_LOGGING_SERVER_LEVEL": "CRITICAL",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MPLBACKEND": "agg",
}.items():
    os.environ.setdefault(_name, _value)

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.episode import ACTION_SIZE, PROPRIOCEPTION_SIZE, SIMULATOR, Episode, EpisodeRecord, Outcome, Source
from juicer.seeding import stream

if TYPE_CHECKING:
    from juicer.demonstration.log import OperatorLog

NUM_PARTS = 5
SIM_STATE_SIZE = 12

EpisodeFactory = Callable[..., Episode]


def make_episode(
    length: int = 12,
    *,
    seed: int = 0,
    num_parts: int = NUM_PARTS,
    sim_state_size: int = SIM_STATE_SIZE,
    **facts: object,
) -> Episode:
    """A well-formed episode of smooth, seeded random numbers; no physics is behind it.

    Args:
        length: Number of actions.
        seed: Initial-state seed of the record; also decides the numbers.
        num_parts: Parts in ``part_poses``.
        sim_state_size: Length of a simulator state.
        facts: Fields of :class:`EpisodeRecord` to set otherwise than a successful one_leg demonstration.
    """
    rng = stream(seed, "synthetic episode")
    walk = _poses(rng, length + 1, num_parts)
    proprioception = np.zeros((length + 1, PROPRIOCEPTION_SIZE), np.float32)
    proprioception[:, :3] = np.cumsum(rng.normal(0, 0.005, (length + 1, 3)), axis=0)
    proprioception[:, 3:9] = (1, 0, 0, 0, 1, 0)
    proprioception[:, 15] = 0.065
    action = np.concatenate([proprioception[1:, :9], np.sign(rng.normal(size=(length, 1)))], axis=1)
    reward = np.zeros(length, np.float32)
    reward[-1] = 1.0
    every_step: Mapping[str, NDArray[np.generic]] = {
        "proprioception": proprioception,
        "part_poses": walk.reshape(length + 1, 7 * num_parts).astype(np.float32),
        "sim_state": np.cumsum(rng.normal(size=(length + 1, sim_state_size)), axis=0),
    }
    known = {
        "source": Source.TELEOP,
        "task": "one_leg",
        "randomness": "low",
        "seed": seed,
        "outcome": Outcome.SUCCESS,
        "parts_assembled": 1,
    }
    return Episode(
        record=EpisodeRecord(**(known | facts)),
        steps={name: values[:-1] for name, values in every_step.items()}
        | {"action": action.astype(np.float32).reshape(length, ACTION_SIZE), "reward": reward},
        final={name: every_step[name][-1] for name in SIMULATOR.ends},
    )


def _poses(rng: np.random.Generator, steps: int, num_parts: int) -> NDArray[np.float64]:
    poses = np.zeros((steps, num_parts, 7))
    poses[..., :3] = rng.normal(0.4, 0.1, (1, num_parts, 3)) + np.cumsum(
        rng.normal(0, 0.002, (steps, num_parts, 3)), axis=0
    )
    quat_wxyz = rng.normal(size=(1, num_parts, 4)) + np.zeros((steps, 1, 1))
    poses[..., 3:] = quat_wxyz / np.linalg.norm(quat_wxyz, axis=-1, keepdims=True)
    return poses


@pytest.fixture
def episode_factory() -> EpisodeFactory:
    """:func:`make_episode`, e.g. ``episode_factory(40, seed=3, outcome=Outcome.TIMEOUT)``."""
    return make_episode


@pytest.fixture
def rng() -> np.random.Generator:
    """A fixed random stream."""
    return stream(0, "test")


@pytest.fixture(scope="session")
def recording() -> OperatorLog:
    """What the scripted operator's assembly of one leg leaves behind, from the reset to success."""
    return _record(0)


@pytest.fixture(scope="session")
def second_recording() -> OperatorLog:
    """Another one, of another initial state."""
    return _record(1)


def _record(seed: int) -> OperatorLog:
    # Imported here: most tests need no simulator.
    from juicer.demonstration.recording import record_demonstration
    from juicer.expert.operator import ScriptedOperator
    from juicer.sim.env import AssemblyEnv

    env = AssemblyEnv("one_leg")
    return record_demonstration(env, ScriptedOperator(env.task, stream(0, "operator", seed)), seed)


@pytest.fixture(scope="session")
def drawing() -> None:
    """Skips where no OpenGL platform can draw."""
    from juicer.errors import RenderingUnavailable
    from juicer.sim.env import AssemblyEnv

    env = AssemblyEnv("one_leg")
    env.reset(seed=0)
    try:
        env.render()
    except RenderingUnavailable as error:
        pytest.skip(str(error))
    finally:
        env.close()


@pytest.fixture(scope="session")
def insertions() -> list[Episode]:
    """Two demonstrations from the simulator: a leg, in the gripper from the start, is inserted and let go."""
    return [_insert(seed) for seed in (0, 1)]


def _insert(seed: int) -> Episode:
    # Imported here: most tests need no simulator.
    from juicer.geometry import matrix_to_rot6d, quat_to_matrix
    from juicer.sim.env import AssemblyEnv
    from juicer.sim.recorder import EpisodeRecorder

    env = AssemblyEnv("one_leg")
    env.reset(seed=seed)
    pair = env.task.pairs[0]
    top = env.observation()["part_poses"][:7].astype(np.float64)
    rotation = quat_to_matrix(top[3:])
    hole = top[:3] + rotation @ pair.targets[pair.operator_target][:3]
    across = rotation[:, 0]
    facing_down = np.stack([np.cross(across, (0, 0, -1)), across, (0, 0, -1)], axis=1)

    def command(offset: tuple[float, float, float], gripper: float) -> NDArray[np.float64]:
        return np.concatenate([hole + offset, matrix_to_rot6d(facing_down), [gripper]])

    aside = (0.02, -0.03, 0.08)
    for _ in range(40):
        env.step(command(aside, -1))
    leg = env.model.joint(env.task.parts[pair.second].name)
    env.data.qpos[leg.qposadr[0] :][:7] = [*(env.observation()["proprioception"][:3] - (0, 0, 0.012)), *top[3:]]
    env.data.qvel[leg.dofadr[0] :][:6] = 0
    for finger in ("panda_finger_joint1", "panda_finger_joint2"):
        env.data.qpos[env.model.joint(finger).qposadr[0]] = 0.0151
    for _ in range(5):
        env.step(command(aside, 1))
    recorder = EpisodeRecorder(env)
    for share in np.linspace(0, 1, 9):
        recorder.step(command(tuple(aside + share * (np.array([0, 0, 0.06]) - aside)), 1))
    for height in np.linspace(0.06, 0, 16):
        recorder.step(command((0, 0, height), 1))
    for height in np.concatenate([np.zeros(8), np.linspace(0, 0.07, 8)]):
        recorder.step(command((0, 0, height), -1))
    return recorder.episode(EpisodeRecord(Source.TELEOP, "one_leg", "low", seed, Outcome.SUCCESS))
