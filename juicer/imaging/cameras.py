"""Front and wrist camera at FurnitureBench's poses, and the rectangle that a view cuts out of what they see."""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.errors import InvalidEpisode
from juicer.sim.panda import END_EFFECTOR_Z, HAND_BODY
from juicer.views import FRONT_CAMERA, WRIST_CAMERA, GazeCrop, StaticCrop, View

FIELD_OF_VIEW_DEG = 42.56
"""Vertical, of both cameras."""
SENSOR_ASPECT = 16 / 9
"""Width by height of all that a camera sees."""
WHOLE_ASPECT = {FRONT_CAMERA: 4 / 3, WRIST_CAMERA: SENSOR_ASPECT}
"""Width by height of the whole image: of the front camera the middle of what it sees."""

_HALF_HEIGHT = math.tan(math.radians(FIELD_OF_VIEW_DEG) / 2)
_FRONT_POSITION = np.array([1.20, 0.0, 0.22])
_NEAREST_GAZE_M = 0.05


def _axes(x_axis: tuple[float, ...], y_axis: tuple[float, ...]) -> NDArray[np.float64]:
    """Rotation whose columns are a camera's axes: right, up, and back."""
    x, y = np.asarray(x_axis, float), np.asarray(y_axis, float)
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


_FRONT_AXES = _axes((0, 1, 0), (-0.181, 0, 0.983))
_WRIST_AXES = _axes((0, -1, 0), (-0.940, 0, 0.342))


class Frustum(NamedTuple):
    """The rectangle that is drawn, one metre in front of the camera [m]."""

    left: float
    right: float
    bottom: float
    top: float

    @classmethod
    def of_image(cls, width: int, height: int) -> Self:
        """All that an undistorted image of this shape shows, from the lower to the upper edge of the view."""
        half_width = _HALF_HEIGHT * width / height
        return cls(-half_width, half_width, -_HALF_HEIGHT, _HALF_HEIGHT)

    @classmethod
    def of_view(cls, view: View, end_effector: NDArray[np.float32]) -> Self:
        """What a view shows.

        Args:
            view: Which.
            end_effector: Position ``(3,)`` in the robot base frame, as in proprioception.

        Raises:
            InvalidEpisode: If a view that is placed by that position gets none that is finite.
        """
        if isinstance(view.crop, GazeCrop):
            return cls._around(view.crop, end_effector, view.width / view.height)
        half_width = _HALF_HEIGHT * WHOLE_ASPECT[view.camera]
        whole = cls(-half_width, half_width, -_HALF_HEIGHT, _HALF_HEIGHT)
        return whole._cropped(view.crop) if isinstance(view.crop, StaticCrop) else whole

    def _cropped(self, crop: StaticCrop) -> Self:
        width, height = self.right - self.left, self.top - self.bottom
        return self._replace(
            left=self.left + crop.left * width,
            right=self.left + crop.right * width,
            bottom=self.top - crop.bottom * height,
            top=self.top - crop.top * height,
        )

    @classmethod
    def _around(cls, crop: GazeCrop, end_effector: NDArray[np.float32], aspect: float) -> Self:
        if not np.isfinite(end_effector).all():
            raise InvalidEpisode(
                "a gaze view cannot be placed: the end effector's position is no finite number, so the simulation had "
                "diverged there; leave out that step or its episode"
            )
        point = np.asarray(end_effector, np.float64) - (0, 0, crop.below_m)
        right, up, back = (point - _FRONT_POSITION) @ _FRONT_AXES
        depth = max(-back, _NEAREST_GAZE_M)
        # It stays within what the camera sees, and keeps its shape.
        half_height = min(crop.reach_m / depth, _HALF_HEIGHT, _HALF_HEIGHT * SENSOR_ASPECT / aspect)
        half_width = half_height * aspect
        room_x, room_y = _HALF_HEIGHT * SENSOR_ASPECT - half_width, _HALF_HEIGHT - half_height
        x = min(max(right / depth, -room_x), room_x)
        y = min(max(up / depth, -room_y), room_y)
        return cls(x - half_width, x + half_width, y - half_height, y + half_height)


def add_cameras(spec: mujoco.MjSpec) -> None:
    """Add both cameras to a scene."""
    spec.worldbody.add_camera(
        name=FRONT_CAMERA, pos=_FRONT_POSITION, quat=_quat(_FRONT_AXES), fovy=FIELD_OF_VIEW_DEG
    )  # fmt: skip
    spec.body(HAND_BODY).add_camera(
        name=WRIST_CAMERA, pos=(-0.04, 0, END_EFFECTOR_Z - 0.05), quat=_quat(_WRIST_AXES), fovy=FIELD_OF_VIEW_DEG
    )


def _quat(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, axes.ravel())
    return quat
