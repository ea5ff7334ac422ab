"""Whether MuJoCo can draw: images of episodes need OpenGL, the rest of juicer does not."""

from __future__ import annotations

import os
from collections.abc import Iterator

from flows.doctor.program import ProgramFailed, run_program
from flows.doctor.verdict import Verdict, ok, problem, warning
from flows.running.settings import Settings

_DRAW = """
import mujoco
scene = "<mujoco><worldbody><light pos='0 0 3'/><geom size='.5' rgba='1 0 0 1'/></worldbody></mujoco>"
model = mujoco.MjModel.from_xml_string(scene)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 48, 64) as renderer:
    renderer.update_scene(data)
    print(int(renderer.render().max()))
"""
_PLATFORMS = ("egl", "osmesa", "glfw")
_REMEDY = (
    "install libegl1 and libgl1-mesa-dri and set MUJOCO_GL=egl, or libosmesa6 and MUJOCO_GL=osmesa; "
    "until then runs work, and reports have no images"
)


def check_drawing(settings: Settings) -> Iterator[Verdict]:
    """Draw one small image."""
    chosen = os.environ.get("MUJOCO_GL", "")
    if chosen.lower() not in ("", *_PLATFORMS):
        yield problem(f"MUJOCO_GL is '{chosen}', which MuJoCo does not know", f"set it to one of {_PLATFORMS}")
        return
    through = f"through MUJOCO_GL={chosen}" if chosen else "through the display"
    try:
        brightest = int(run_program(_DRAW).split()[-1])
    except ProgramFailed as failure:
        yield warning(f"drawing an image {through} {failure}", _REMEDY)
        return
    if brightest:
        yield ok(f"an image was drawn {through}")
    else:
        yield warning(f"an image drawn {through} is black", _REMEDY)
