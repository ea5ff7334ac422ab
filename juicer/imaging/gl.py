"""Which OpenGL platform draws images on this machine."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Any


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
