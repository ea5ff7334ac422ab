"""What libraries read when they are imported, and must therefore find set before."""

from __future__ import annotations

import os
import sys


def prepare_machine() -> None:
    """Let MuJoCo draw through EGL where there is no display."""
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")
