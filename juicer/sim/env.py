"""The assembly environment: robot, parts and contact physics behind Gymnasium's interface.

Everything shown is in the robot base frame: x forward, y to the robot's left, z up, metres; the table's surface lies
at z = -0.015. Part poses are ``(position, quaternion wxyz)`` of the part frames defined in :mod:`juicer.tasks`.
One step is exactly 0.1 s of simulated time.
"""

from __future__ import annotations

import copy
import importlib
from functools import lru_cache
from typing import Any, Protocol, Self

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from juicer.episode import ACTION_SIZE, PROPRIOCEPTION_SIZE, Outcome
from juicer.errors import ConfigError, InvalidAction
from juicer.seeding import stream
from juicer.shifts import ShiftOfEpisode, parse_shift
from juicer.sim.arguments import checked_count, checked_options, checked_seed, shown
from juicer.sim.controller import MAX_ACTION, EndEffectorController, grip_command, validate_action
from juicer.sim.initial_states import initial_part_poses
from juicer.sim.milestones import BaseProgress, PairProgress
from juicer.sim.panda import GRIP_FORCE_N, NUM_ARM_JOINTS, RESET_JOINTS_RAD
from juicer.sim.scene import TIMESTEP_S, build_spec
from juicer.sim.shifting import marked, push, shift_model, unmarked
from juicer.sim.state import AWAKE_COUNTS, DIVERGED_SPEED, SimulatorState
from juicer.sim.views import SceneViews
from juicer.tasks.registry import get_task
from juicer.tasks.specification import TABLE_HEIGHT_M, parse_randomness
from juicer.views import FRONT_CAMERA, View

TARGET_UPDATES = 10
SUBSTEPS_PER_UPDATE = 5
STEP_S = TARGET_UPDATES * SUBSTEPS_PER_UPDATE * TIMESTEP_S
CONTROL_HZ = round(1 / STEP_S)
_FRACTIONS = np.arange(1, TARGET_UPDATES + 1)[:, None] / TARGET_UPDATES
SETTLING_S = 0.3
# A part this far below the table's surface has fallen off it.
_LOST_BELOW_M = TABLE_HEIGHT_M - 0.05

_RENDERER, _GL = "juicer.imaging.renderer", "juicer.imaging.gl"
"""Loaded by name when an image is asked for: only results of those who look depend on what draws, by the views in their
configurations."""

Observation = dict[str, NDArray[np.float32]]


class Renderer(Protocol):
    """Draws one task's scene; see :class:`juicer.imaging.renderer.ViewRenderer`."""

    def draw(
        self,
        qpos: NDArray[np.float64],
        view: View,
        end_effector: NDArray[np.float32],
        shift: ShiftOfEpisode | None = None,
    ) -> NDArray[np.uint8]:
        """Image ``(height, width, 3)`` of a view, under a shift."""
        ...

    def draw_for_people(self, qpos: NDArray[np.float64], camera: str, width: int, height: int) -> NDArray[np.uint8]:
        """Image ``(height, width, 3)`` of a camera."""
        ...

    def close(self) -> None:
        """Free what it holds."""
        ...


@lru_cache(maxsize=8)
def _compiled_model(task_name: str) -> mujoco.MjModel:
    """Model of a task, compiled once a process; environments get copies, which cost a fifteenth of it."""
    return build_spec(get_task(task_name)).compile()


def gl_name() -> str:
    """What draws images in this process, in the words of its OpenGL platform.

    Raises:
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    return str(importlib.import_module(_GL).gl_name())


class AssemblyEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """One robot assembling one piece of furniture.

    Observation: ``proprioception`` (16) and ``part_poses`` (7 a part), see :mod:`juicer.episode`.
    Action: absolute end-effector target (position, 6D rotation, gripper), shape (10,).
    Reward: number of pairs assembled for the first time in the step. Ends when all pairs are assembled, a part has
    fallen off the table, or the simulation diverged; ``info["outcome"]`` says which.

    A copy (``copy.copy``, ``copy.deepcopy``, ``pickle``) is an environment of its own that goes on exactly from the
    original's present state, with the same model, limits and random numbers. Nothing is shared between environments.

    Attributes:
        task: What is assembled.
        randomness: Level of the initial states.
        max_steps: Steps after which an episode times out.
        model: MuJoCo's model of the scene, this environment's own; what is changed in it stays changed.
        data: MuJoCo's state of the scene.
        shift: The shift that it was made with, and what the present episode makes of it; None without one.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": CONTROL_HZ}  # noqa: RUF012 (Gymnasium's own protocol)

    def __init__(
        self,
        task: str = "one_leg",
        randomness: str = "low",
        render_mode: str | None = None,
        max_steps: int | None = None,
        shift: object = None,
    ) -> None:
        """Build the scene; ``max_steps`` defaults to the task's own limit.

        A shift, for evaluation, is one of :mod:`juicer.shifts`, its kind and settings as a mapping, or its kind alone.

        Raises:
            ConfigError: If the task, the randomness or the render mode is unknown, ``max_steps`` is no step number, or
                there is no such shift.
        """
        self.task = get_task(task)
        self.randomness = parse_randomness(randomness)
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigError(f"unknown render_mode {shown(render_mode)}; valid: None, 'rgb_array'")
        self.render_mode = render_mode
        self.max_steps = self.task.max_steps if max_steps is None else checked_count("max_steps", max_steps)
        self.metadata = copy.deepcopy(self.metadata)
        self.data = mujoco.MjData(copy.copy(_compiled_model(task)))
        self.shift = shift_model(self.data.model, parse_shift(shift), self.randomness)
        self._controller = EndEffectorController()
        self._milestones = self.task.milestones
        self._progress = np.zeros(1 + len(self.task.pairs) + len(self._milestones))
        self._base = BaseProgress(self.task)
        self._pairs = tuple(PairProgress(self.task, pair) for pair in self.task.pairs)
        self._velocity = np.empty(6)
        self._has_begun = False
        self._attach()
        self.action_space = spaces.Box(-MAX_ACTION, MAX_ACTION, (ACTION_SIZE,), np.float32)
        observations: dict[str, spaces.Space[Any]] = {
            "proprioception": spaces.Box(-np.inf, np.inf, (PROPRIOCEPTION_SIZE,), np.float32),
            "part_poses": spaces.Box(-np.inf, np.inf, (7 * len(self.task.parts),), np.float32),
        }
        self.observation_space = spaces.Dict(observations)  # type: ignore[assignment]  # stubs: a Dict space is no Space[dict]

    def _attach(self) -> None:
        """Derive from ``data`` what belongs to it and to no copy of it."""
        self.model: mujoco.MjModel = self.data.model
        self._views = SceneViews(self.model, self.data, self.task)
        self._state = SimulatorState(self.model, len(self.task.pairs), len(self._milestones))
        self._renderer: Renderer | None = None

    def __copy__(self) -> Self:
        return copy.deepcopy(self)

    def __getstate__(self) -> dict[str, Any]:
        derived = ("model", "_views", "_state", "_renderer")
        kept = {name: value for name, value in self.__dict__.items() if name not in derived}
        # MuJoCo's own pickle of its data forgets these.
        return kept | {"awake": {name: getattr(self.data, name) for name in AWAKE_COUNTS}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        awake = state.pop("awake")
        self.__dict__.update(state)
        for name, count in awake.items():
            setattr(self.data, name, count)
        self._attach()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; the initial state depends on ``seed`` alone.

        Args:
            seed: Zero or a positive integer; None goes on with the random numbers of the last seed.
            options: There are none.

        Raises:
            ConfigError: If the seed is no such number, or an option is given.
        """
        checked_options(options, known=())
        seed = checked_seed(seed)
        super().reset(seed=seed)
        seed = int(self.np_random.integers(2**31)) if seed is None else seed
        shift = self.shift.shift if self.shift else None
        poses = initial_part_poses(self.task, self.randomness, stream(seed, "initial_state"), shift)
        self.shift = ShiftOfEpisode.of(shift, seed) if shift else None
        mujoco.mj_resetData(self.model, self.data)
        views = self._views
        views.joints[:] = views.joint_targets[:] = RESET_JOINTS_RAD
        views.fingers[:] = self.task.gripper_width_m / 2
        views.controls[NUM_ARM_JOINTS] = GRIP_FORCE_N
        views.part_poses[:] = poses.ravel()
        self._settle()
        self.data.time = 0.0
        self._progress[:] = -1
        self._progress[: 1 + len(self.task.pairs)] = 0
        self._measure()
        self._has_begun = True
        return self.observation(), self._info()

    def step(self, action: NDArray[Any]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move for 0.1 s.

        Raises:
            InvalidAction: If the action is not finite, has a wrong shape or encodes no rotation, or if the environment
                was never reset; nothing has moved.
        """
        self._require_begun()
        values = validate_action(action)
        if self.shift:
            push(self.shift, self.task, self.data, int(self._progress[0]), STEP_S)
        targets, controls = self._views.joint_targets, self._views.controls
        goal = self._controller.joint_targets(values, self._views.joints)
        controls[NUM_ARM_JOINTS] = grip_command(values, float(controls[NUM_ARM_JOINTS]))
        for update in targets + _FRACTIONS * (goal - targets):
            targets[:] = update
            if not self._advance():
                break
        self._progress[0] += 1
        reward = 0.0 if self._has_diverged() else self._measure()
        info = self._info()
        outcome = info["outcome"]
        truncated = outcome is Outcome.TIMEOUT
        return self.observation(), reward, outcome is not None and not truncated, truncated, info

    def observation(self) -> Observation:
        """What a policy may see of the present state, in arrays of its own."""
        views = self._views
        proprioception = np.empty(PROPRIOCEPTION_SIZE)
        proprioception[:3] = views.position
        proprioception[3:9] = views.matrix_rows
        # MuJoCo gives the rotational velocity first.
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_SITE, views.site, self._velocity, 0)
        proprioception[9:12], proprioception[12:15] = self._velocity[3:], self._velocity[:3]
        proprioception[15] = views.fingers.sum()
        with np.errstate(over="ignore"):  # a diverged state may exceed single precision
            return {
                "proprioception": proprioception.astype(np.float32),
                "part_poses": views.part_poses.astype(np.float32),
            }

    def get_state(self) -> NDArray[np.float64]:
        """Everything that decides the future, as a vector; see :meth:`set_state`."""
        return marked(self._state.read(self.data, self._progress), self.shift)

    def set_state(self, state: NDArray[np.float64]) -> None:
        """Continue exactly (bit for bit) from a state that :meth:`get_state` returned.

        Raises:
            InvalidEpisode: If it is not a state of this scene under this shift, or of one that diverged; nothing has
                changed.
        """
        state, shift = unmarked(state, self.shift)
        self._state.write(self.data, self._progress, state)
        self.shift = shift
        self._has_begun = True

    def contact_pairs(self) -> frozenset[tuple[str, str]]:
        """Names of touching things, each pair sorted; links of the gripper count as ``gripper``."""
        contacts = self.data.contact
        bodies = self.model.geom_bodyid[contacts.geom[contacts.dist <= 0.0]]
        names = ((self._body_name(first), self._body_name(second)) for first, second in bodies)
        return frozenset((min(pair), max(pair)) for pair in names)

    def render(self) -> NDArray[np.uint8]:
        """Image ``(480, 640, 3)`` of the front camera, for people; any thread may ask for it.

        Raises:
            InvalidAction: If the environment was never reset.
            RenderingUnavailable: If no OpenGL platform can draw.
        """
        return self.render_camera(FRONT_CAMERA, 640, 480)

    def render_camera(self, camera: str, width: int, height: int) -> NDArray[np.uint8]:
        """Undistorted image ``(height, width, 3)`` of a camera, ``front`` or ``wrist``, for people; see :meth:`render`.

        It has shadows and smooth edges, and costs many times what :meth:`render_view` does.

        Raises:
            ConfigError: If there is no such camera, or no such size.
        """
        return self._drawing().draw_for_people(self.data.qpos, camera, width, height)

    def render_view(self, view: View) -> NDArray[np.uint8]:
        """Image ``(height, width, 3)`` of a view, as policies are shown it; see :meth:`render`.

        It depends on the positions of the joints alone, so a restored state gives the same image to the last bit.

        Raises:
            ConfigError: If the robot's mesh is asked for and not installed.
        """
        return self._drawing().draw(self.data.qpos, view, self._views.position.astype(np.float32), self.shift)

    def _drawing(self) -> Renderer:
        self._require_begun()
        if self._renderer is None:
            self._renderer = importlib.import_module(_RENDERER).ViewRenderer(self.task.name)
        return self._renderer

    def close(self) -> None:
        """Free the renderer; may be called again, and a later image makes a new one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _measure(self) -> float:
        """Bring derived positions up to date, latch pairs and milestones, and return the reward."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_comVel(self.model, self.data)
        positions, matrices = self._views.part_positions, self._views.part_matrices
        pairs = len(self._pairs)
        assembled = self._progress[1 : 1 + pairs]
        reward = 0.0
        milestones = [self._base.is_placed(positions)]
        for index, pair in enumerate(self._pairs):
            *on_the_way, passes = pair.measure(positions, matrices)
            if passes and not assembled[index] and all(assembled[before] for before in pair.pair.after):
                assembled[index] = 1
                reward += 1.0
            milestones += [*on_the_way, bool(assembled[index])]
        first_steps = self._progress[1 + pairs :]
        for index, reached in enumerate(milestones):
            if reached and first_steps[index] < 0:
                first_steps[index] = self._progress[0]
        return reward

    def _settle(self) -> None:
        """Let the parts come to rest; what would roll is kept from it, and sleeps from then on until it is touched."""
        steps = round(SETTLING_S / self.model.opt.timestep)
        for _ in range(0, steps, SUBSTEPS_PER_UPDATE):
            mujoco.mj_step(self.model, self.data, SUBSTEPS_PER_UPDATE)
            for part in self._views.rolling:
                self._views.velocities[part] = 0.0

    def _advance(self) -> bool:
        try:
            mujoco.mj_step(self.model, self.data, SUBSTEPS_PER_UPDATE)
        except mujoco.FatalError:
            # An explosion makes more contacts than fit into MuJoCo's memory; the state may still look finite.
            self._views.velocities[:] = np.nan
            return False
        return True

    def _has_diverged(self) -> bool:
        return not mujoco.mju_norm(self._views.velocities) < DIVERGED_SPEED  # NaN compares false

    @property
    def has_begun(self) -> bool:
        """Whether there is a state to go on from: after the first :meth:`reset` or :meth:`set_state`."""
        return self._has_begun

    @property
    def outcome(self) -> Outcome | None:
        """How the episode has ended; None as long as it goes on."""
        return self._outcome(self._parts_assembled())

    def _outcome(self, parts_assembled: int) -> Outcome | None:
        if self._has_diverged():
            return Outcome.DIVERGED
        if parts_assembled == len(self.task.pairs):
            return Outcome.SUCCESS
        if min(self._views.part_positions[:, 2].tolist()) < _LOST_BELOW_M:
            return Outcome.PART_LOST
        return Outcome.TIMEOUT if self._progress[0] >= self.max_steps else None

    def _info(self) -> dict[str, Any]:
        pairs = len(self.task.pairs)
        parts_assembled = self._parts_assembled()
        first_steps = zip(self._milestones, self._progress[1 + pairs :].tolist(), strict=True)
        return {
            "outcome": self._outcome(parts_assembled),
            "parts_assembled": parts_assembled,
            "milestones": {name: int(step) for name, step in first_steps if step >= 0},
        }

    def _parts_assembled(self) -> int:
        return int(sum(self._progress[1 : 1 + len(self.task.pairs)].tolist()))

    def _require_begun(self) -> None:
        if not self._has_begun:
            raise InvalidAction("the environment has no state to go on from; call reset() first, or set_state()")

    def _body_name(self, body: int) -> str:
        name = self.model.body(body).name
        if name.startswith(("panda_hand", "panda_finger")):
            return "gripper"
        return "arm" if name.startswith("panda") else name
