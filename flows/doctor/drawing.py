"""Whether images of episodes can be drawn here: they need OpenGL, the rest of juicer does not."""

from __future__ import annotations

import os
from collections.abc import Iterator

from flows.doctor.program import ProgramFailed, run_program
from flows.doctor.verdict import Verdict, ok, problem, warning
from flows.running.settings import Settings
from juicer.imaging.gl import gl_platform

_DRAW = """
from juicer.sim.env import AssemblyEnv
from juicer.views import View
with AssemblyEnv() as env:
    env.reset(seed=0)
    print(int(env.render_view(View(camera="front")).max()))
"""
_PLATFORMS = ("egl", "osmesa", "glfw")
_REMEDY = (
    "install libegl1 and libgl1-mesa-dri and set MUJOCO_GL=egl, or libosmesa6 and MUJOCO_GL=osmesa; "
    "until then policies that look at images cannot be made, and reports have no images"
)


def check_drawing(settings: Settings) -> Iterator[Verdict]:
    """Draw one small image."""
    chosen = os.environ.get("MUJOCO_GL", "")
    if chosen.lower() not in ("", *_PLATFORMS):
        yield problem(f"MUJOCO_GL is '{chosen}', which MuJoCo does not know", f"set it to one of {_PLATFORMS}")
        return
    through = f"through MUJOCO_GL={chosen}" if chosen else f"through {gl_platform() or 'the display'}"
    try:
        brightest = int(run_program(_DRAW).split()[-1])
    except ProgramFailed as failure:
        yield warning(f"drawing an image {through} {failure}", _REMEDY)
        return
    if brightest:
        yield ok(f"an image was drawn {through}")
    else:
        yield warning(f"an image drawn {through} is black", _REMEDY)
