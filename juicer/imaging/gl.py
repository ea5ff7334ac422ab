"""Which OpenGL platform draws images on this machine."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Any

import mujoco


def gl_context_class() -> type[Any]:
    """MuJoCo's class of OpenGL contexts: that of ``MUJOCO_GL``, or on Linux EGL, which needs no display.

    The variable is read when the first image is drawn. MuJoCo's own choice falls when MuJoCo is imported, which may
    be long before any code of ours runs.

    Raises:
        ImportError: If the platform's libraries are not installed.
        AttributeError: If ``MUJOCO_GL`` turns drawing off.
    """
    platform = os.environ.get("MUJOCO_GL", "").strip().lower()
    if not platform and sys.platform == "linux":
        platform = "egl"
    chosen = import_module(f"mujoco.{platform}") if platform in ("egl", "osmesa") else mujoco
    context: type[Any] = chosen.GLContext
    return context
