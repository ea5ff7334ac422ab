"""What somebody sees who drives the robot: three views in which depth can be judged, and which no policy is ever shown.

Nothing here is used by :mod:`juicer.imaging.renderer`, whose images policies learn from, so nothing here changes one.

Two lines tell where the gripper is: a red one out of it, as the original draws it, and a blue one straight down from
between its fingertips. Parts are put into each other from above, and a gripper that holds one is often tilted: then it
is the blue line that ends where the part would go.
"""

from __future__ import annotations

from enum import StrEnum

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.imaging.cameras import Frustum
from juicer.imaging.gl import current_context, unavailable
from juicer.imaging.look import Look
from juicer.imaging.visual_model import visual_spec
from juicer.sim.panda import END_EFFECTOR_SITE
from juicer.tasks.registry import get_task
from juicer.tasks.specification import TABLE_HEIGHT_M
from juicer.views import FRONT_CAMERA, MAX_HEIGHT, MAX_WIDTH, WRIST_CAMERA

Image = NDArray[np.uint8]
Vector = NDArray[np.float64]


class OperatorView(StrEnum):
    """From where the scene is seen."""

    FRONT = "front"
    """The scene as the front camera sees it, without what is beside and above the work."""
    SIDE = "side"
    """What is around the end effector, at a right angle to that, from the operator's right."""
    WRIST = "wrist"
    """What is between and below the fingertips, enlarged, without the hand that hides it from the wrist camera."""


_LIGHT_DIRECTION = (-0.28, 0.05, -0.93)
"""Nearly from above, so that the shadow of a part falls next to where it would go."""
_FRONT_SHARE, _FRONT_BELOW = 0.86, 0.88
"""Share of the front camera's image that is shown, and how far below its middle that begins, of its half height."""
_SIDE_DIRECTION = np.array([0.0, -0.92, -0.39])
_SIDE_DISTANCE_M, _SIDE_ABOVE_M, _SIDE_BELOW_TABLE_M, _SIDE_LEAST_REACH_M = 0.6, 0.09, 0.06, 0.12
"""Shown is what is around the end effector, from so far above it down to so far below the table's surface, and more of
the table when that is less than twice the reach."""
_WRIST_REACH_M, _WRIST_AHEAD_M = 0.06, 0.015
"""Half of the height that is shown, around a point so far ahead of the end effector."""
_WRIST_NEAREST = 0.5
"""Share of the distance to that point before which nothing is drawn: there is the hand."""
_LINE_M, _LINE_PIXELS = 0.5, 2.0
_RED, _BLUE = (np.array(rgba, np.float32) for rgba in ((1.0, 0.05, 0.05, 1.0), (0.2, 0.7, 1.0, 1.0)))
_FRAME = np.eye(3).ravel()


class OperatorRenderer:
    """Draws a task's scene from joint positions, in the thread that makes it and in no other."""

    def __init__(self, task_name: str) -> None:
        """Open a context.

        Raises:
            ConfigError: If there is no such task.
            RenderingUnavailable: If no OpenGL platform can draw.
        """
        self._model = _model(task_name)
        self._data = mujoco.MjData(self._model)
        self._platform = current_context(MAX_WIDTH, MAX_HEIGHT)
        try:
            self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_50)
        except Exception as error:
            self._platform.free()
            raise unavailable(error) from None
        self._scene = mujoco.MjvScene(self._model, maxgeom=self._model.ngeom + self._model.nsite + 2)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._options = mujoco.MjvOption()
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._site = self._model.site(END_EFFECTOR_SITE).id

    def draw(
        self,
        qpos: Vector,
        view: OperatorView,
        width: int,
        height: int,
        *,
        shadows: bool = False,
        lines: bool = True,
    ) -> Image:
        """The image ``(height, width, 3)`` of a view.

        Args:
            qpos: The simulator's joint positions ``(nq,)``.
            view: What is shown.
            width: Pixels, at most :data:`juicer.views.MAX_WIDTH`.
            height: Pixels, at most :data:`juicer.views.MAX_HEIGHT`.
            shadows: Whether things cast shadows, which costs several times what the rest does.
            lines: Whether the two lines are drawn.
        """
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        self._place(view)
        self._aim(view, width / height)
        if lines:
            self._add_lines()
        return self._pixels(width, height)

    def close(self) -> None:
        """Free what drawing takes."""
        self._context.free()
        self._platform.free()

    def _place(self, view: OperatorView) -> None:
        """Put the scene and its camera in place."""
        scene, name = self._scene, WRIST_CAMERA if view is OperatorView.WRIST else FRONT_CAMERA
        self._camera.fixedcamid = self._model.camera(name).id
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, self._data, self._options, None, self._camera, everything, scene)
        if view is OperatorView.SIDE:
            forward = _SIDE_DIRECTION / np.linalg.norm(_SIDE_DIRECTION)
            up = np.cross([-1.0, 0.0, 0.0], forward)
            below = (0, 0, self._side_reach - _SIDE_ABOVE_M)
            position = self._end_effector - below - _SIDE_DISTANCE_M * forward
            for eye in scene.camera:
                eye.pos[:], eye.forward[:], eye.up[:] = position, forward, up

    def _aim(self, view: OperatorView, aspect: float) -> None:
        """Choose the rectangle that is shown."""
        nearest = None
        if view is OperatorView.FRONT:
            half = Frustum.of_image(1, 1).top
            bottom = -_FRONT_BELOW * half
            middle_x, middle_y, half = 0.0, bottom + _FRONT_SHARE * half, _FRONT_SHARE * half
        elif view is OperatorView.SIDE:
            middle_x, middle_y, half = 0.0, 0.0, self._side_reach / _SIDE_DISTANCE_M
        else:
            camera = self._camera.fixedcamid
            axes = self._data.cam_xmat[camera].reshape(3, 3)
            point = self._end_effector + _WRIST_AHEAD_M * self._approach
            right, up, back = (point - self._data.cam_xpos[camera]) @ axes
            middle_x, middle_y, half = right / -back, up / -back, _WRIST_REACH_M / -back
            nearest = _WRIST_NEAREST * -back
        for eye in self._scene.camera:
            near = eye.frustum_near = nearest or eye.frustum_near
            eye.frustum_center, eye.frustum_width = near * middle_x, near * half * aspect
            eye.frustum_bottom, eye.frustum_top = near * (middle_y - half), near * (middle_y + half)

    def _add_lines(self) -> None:
        scene, start = self._scene, self._end_effector
        for direction, rgba in ((self._approach, _RED), (np.array([0.0, 0.0, -1.0]), _BLUE)):
            line, kind = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_LINE
            mujoco.mjv_initGeom(line, kind, np.zeros(3), np.zeros(3), _FRAME, rgba)
            mujoco.mjv_connector(line, kind, _LINE_PIXELS, start, start + _LINE_M * direction)
            line.emission = 1.0
            scene.ngeom += 1

    def _pixels(self, width: int, height: int) -> Image:
        context = self._context
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
        if width > context.offWidth or height > context.offHeight:
            mujoco.mjr_resizeOffscreen(max(width, context.offWidth), max(height, context.offHeight), context)
        viewport = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(viewport, self._scene, context)
        image = np.empty((height, width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(image, None, viewport, context)
        # OpenGL's first row is the lowest.
        return np.ascontiguousarray(image[::-1])

    @property
    def _side_reach(self) -> float:
        """Half of the height that the view from the side shows [m]: little when the gripper is low."""
        shown = _SIDE_ABOVE_M + float(self._end_effector[2]) - TABLE_HEIGHT_M + _SIDE_BELOW_TABLE_M
        return max(shown / 2, _SIDE_LEAST_REACH_M)

    @property
    def _end_effector(self) -> Vector:
        position: Vector = self._data.site_xpos[self._site].copy()
        return position

    @property
    def _approach(self) -> Vector:
        """Direction in which the gripper points."""
        axis: Vector = self._data.site_xmat[self._site].reshape(3, 3)[:, 2]
        return axis


def _model(task_name: str) -> mujoco.MjModel:
    spec = visual_spec(get_task(task_name), Look(for_people=True))
    for light in spec.lights:
        light.dir = _LIGHT_DIRECTION
    # Smooth edges would double what a frame costs, and finer shadows too.
    spec.visual.quality.offsamples = 0
    spec.visual.quality.shadowsize = 512
    return spec.compile()
