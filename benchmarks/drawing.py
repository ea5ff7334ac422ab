"""What drawing costs: CPU milliseconds a pair of front and wrist images, and how much that is of what it was.

python -m benchmarks.drawing [--tasks one_leg round_table lamp square_table] [--pairs 60]

*Physics* is what was drawn before there was a visual model: the simulated model's own geometry with MuJoCo's default
of four samples a pixel. It is measured in turn with ours, so that other work on the machine troubles both alike. All
threads of the process are counted; the median of the pairs is shown.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from statistics import median

import mujoco
import numpy as np

from juicer.imaging.cameras import add_cameras
from juicer.imaging.gl import gl_context_class
from juicer.sim.env import AssemblyEnv
from juicer.sim.scene import build_spec
from juicer.tasks.registry import TASK_NAMES, get_task
from juicer.views import CAMERAS, MAX_HEIGHT, MAX_WIDTH, GazeCrop, View

SIZES = ((96, 96), (128, 128), (224, 224), (320, 240))


def main() -> None:
    """Print one line a task and size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", default=TASK_NAMES, choices=TASK_NAMES)
    parser.add_argument("--pairs", type=int, default=60)
    options = parser.parse_args()
    context = gl_context_class()(MAX_WIDTH, MAX_HEIGHT)
    context.make_current()
    print(f"{'task':<13} {'size':>8} {'ours':>8} {'physics':>9} {'ratio':>6} {'gaze':>8} {'people':>8}   ms a pair")
    for name in options.tasks:
        with AssemblyEnv(name) as env:
            env.reset(seed=0)
            physics = PhysicsDrawing(name, env)
            for width, height in SIZES:
                ours, before, gaze, people = measured(env, physics, width, height, options.pairs)
                print(
                    f"{name:<13} {f'{width}x{height}':>8} {ours:8.2f} {before:9.2f} {before / ours:6.1f} "
                    f"{gaze:8.2f} {people:8.2f}",
                    flush=True,
                )
            physics.close()
    context.free()


def measured(env: AssemblyEnv, physics: PhysicsDrawing, width: int, height: int, pairs: int) -> list[float]:
    """Of our pair, the physics' pair, one gaze crop, and a pair for people."""
    whole = [View.model_validate({"camera": each, "width": width, "height": height}) for each in CAMERAS]
    gaze = View(camera="front", crop=GazeCrop(), width=width, height=height)
    return medians(
        pairs,
        lambda: [env.render_view(each) for each in whole],
        lambda: physics.pair(width, height),
        lambda: env.render_view(gaze),
        lambda: [env.render_camera(each, width, height) for each in CAMERAS],
    )


def medians(times: int, *draw: Callable[[], object]) -> list[float]:
    """Median CPU milliseconds of each, drawn in turn."""
    spent: list[list[float]] = [[] for _ in draw]
    for count in range(times + 3):
        for index, each in enumerate(draw):
            start = time.process_time()
            each()
            # The first ones make what the others use.
            if count >= 3:
                spent[index].append(1000 * (time.process_time() - start))
    return [median(each) for each in spent]


class PhysicsDrawing:
    """Draws the simulated model itself, in this thread."""

    def __init__(self, task: str, env: AssemblyEnv) -> None:
        """Take over the state of an environment."""
        spec = build_spec(get_task(task))
        add_cameras(spec)
        spec.visual.global_.offwidth, spec.visual.global_.offheight = MAX_WIDTH, MAX_HEIGHT
        spec.visual.quality.numslices, spec.visual.quality.numstacks = 14, 8
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = env.data.qpos
        mujoco.mj_forward(self._model, self._data)
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_150)
        self._scene = mujoco.MjvScene(self._model, maxgeom=10_000)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0

    def pair(self, width: int, height: int) -> list[np.ndarray]:
        """Front and wrist."""
        return [self._draw(camera, width, height) for camera in CAMERAS]

    def _draw(self, name: str, width: int, height: int) -> np.ndarray:
        camera = mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, self._model.camera(name).id
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, self._data, mujoco.MjvOption(), None, camera, everything, self._scene)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        viewport = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(viewport, self._scene, self._context)
        image = np.empty((height, width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(image, None, viewport, self._context)
        return image[::-1].copy()

    def close(self) -> None:
        """Free it."""
        self._context.free()


if __name__ == "__main__":
    main()
