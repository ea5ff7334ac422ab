"""What MuJoCo reads when it is imported, and must therefore find set before."""

from __future__ import annotations

import os
import sys


def draw_without_display() -> None:
    """Let MuJoCo draw through EGL where there is no display, unless ``MUJOCO_GL`` says how."""
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")
