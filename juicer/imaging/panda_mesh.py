"""The real look of the robot: the meshes of the package dm-robotics-panda, which are read as data and never imported.

Its links have the frames of ours (both are the published modified DH parameters).
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import mujoco

from juicer.errors import ConfigError
from juicer.text import printable

PACKAGE, VERSION = "dm-robotics-panda", "0.4.8"
_FOLDER = "dm_robotics/panda/assets/panda"
_ROBOT = "panda_"
_BODIES = {
    "world": "link0",
    **{f"panda_link{number}": f"link{number}" for number in range(1, 8)},
    "panda_hand": "hand",
    "panda_finger1": "finger",
    "panda_finger2": "finger",
}
_HALF_TURN = {"panda_finger2": (0.0, 0.0, 0.0, 1.0)}
"""The right finger is the left one turned about the hand's axis."""


@cache
def has_panda_mesh() -> bool:
    """Whether the package is installed."""
    try:
        return distribution(PACKAGE).version == VERSION
    except PackageNotFoundError:
        return False


def is_of_robot(geom: mujoco.MjsGeom) -> bool:
    """Whether the meshes show what a geom of the physics stands for: a link, or the pedestal."""
    return str(geom.parent.name).startswith(_ROBOT) or bool(geom.type == mujoco.mjtGeom.mjGEOM_CYLINDER)


def add_panda_mesh(spec: mujoco.MjSpec) -> None:
    """Add the robot's meshes to the bodies of a scene.

    Raises:
        ConfigError: If the package is not installed.
    """
    if not has_panda_mesh():
        raise ConfigError(
            f"the robot's mesh is in the package {PACKAGE} {VERSION}, which is not installed; "
            "install it with `make looks`, or draw the robot as primitives"
        )
    texture = spec.add_texture(name=PACKAGE, type=mujoco.mjtTexture.mjTEXTURE_2D, file=_asset("panda.png"))
    material = spec.add_material(name=PACKAGE, specular=0.4, shininess=0.4)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture.name
    for mesh in sorted(set(_BODIES.values())):
        spec.add_mesh(name=mesh, file=_asset(f"{mesh}.obj"), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    for body, mesh in _BODIES.items():
        spec.body(body).add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh, material=material.name, contype=0, conaffinity=0,
            quat=_HALF_TURN.get(body, (1.0, 0.0, 0.0, 0.0)),
        )  # fmt: skip


def unreadable_panda_mesh(error: ValueError) -> ConfigError:
    """What a user is told if a file is damaged, by MuJoCo's own reason."""
    return ConfigError(
        f"the robot's mesh cannot be read ({printable(error)}); remove {PACKAGE} with pip and install it again with "
        "`make looks`, or draw the robot as primitives"
    )


def _asset(name: str) -> str:
    return str(Path(str(distribution(PACKAGE).locate_file(_FOLDER))) / name)
