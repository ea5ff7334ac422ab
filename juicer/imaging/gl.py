"""Which OpenGL platform draws images on this machine."""

from __future__ import annotations

import os
import sys
from functools import cache
from importlib import import_module
from typing import Any

from juicer.errors import RenderingUnavailable
from juicer.text import printable


def gl_platform() -> str:
    """That of ``MUJOCO_GL``, or on Linux ``egl``, which needs no display; empty for MuJoCo's own choice elsewhere.

    The variable is read when the first image is drawn. MuJoCo's own choice falls when MuJoCo is imported, which may
    be long before any code of ours runs.
    """
    chosen = os.environ.get("MUJOCO_GL", "").strip().lower()
    return chosen or ("egl" if sys.platform == "linux" else "")


def gl_context_class() -> type[Any]:
    """MuJoCo's class of OpenGL contexts on that platform.

    Raises:
        ImportError: If the platform's libraries are not installed.
        AttributeError: If ``MUJOCO_GL`` turns drawing off.
    """
    platform = gl_platform()
    module = import_module(f"mujoco.{platform}" if platform in ("egl", "osmesa") else "mujoco")
    context: type[Any] = module.GLContext
    return context


def unavailable(error: Exception) -> RenderingUnavailable:
    """Every OpenGL platform fails in its own way."""
    return RenderingUnavailable(
        f"no OpenGL platform can draw an image here ({type(error).__name__}: {printable(error)}); "
        "set MUJOCO_GL=egl with libegl1 and libgl1-mesa-dri installed, or MUJOCO_GL=osmesa with libosmesa6"
    )


def current_context(width: int, height: int) -> Any:
    """A new OpenGL context, current in this thread.

    Raises:
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    try:
        context = gl_context_class()(width, height)
    except Exception as error:
        raise unavailable(error) from None
    try:
        context.make_current()
    except Exception as error:
        context.free()
        raise unavailable(error) from None
    return context


@cache
def gl_name() -> str:
    """What draws images in this process, in the words of its OpenGL platform; the same scene differs with it.

    Raises:
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    context = current_context(1, 1)
    try:
        # Which of the platforms it speaks to, this library reads when it is imported.
        gl = import_module("OpenGL.GL")
        # The renderer alone is the same for two versions of Mesa.
        names = [gl.glGetString(each) or b"nameless" for each in (gl.GL_RENDERER, gl.GL_VERSION)]
    finally:
        context.free()
    return printable(", ".join(name.decode(errors="replace") for name in names))
