"""How fast robosuite draws a front and a wrist image of 320x240 pixels, beside juicer, in one run.

python -m benchmarks.peers.robosuite_drawing [--environment /tmp/robosuite] [--rounds 10] [--pairs 5]

robosuite 1.5.2 needs MuJoCo 3.3.7, so it is installed into a virtual environment of its own, which the first run makes
in the folder ``--environment``. Its process and this one take turns; CPU time of all threads is counted, so that other
work on the machine disturbs little. Each draws its own scene (there NutAssemblySquare with a Panda) as policies are
shown it by default: robosuite with shadows and four samples a pixel, ours plain. Ours for people has both too.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
import venv
from collections.abc import Callable
from pathlib import Path
from statistics import median

from juicer.sim.env import AssemblyEnv
from juicer.views import CAMERAS, View

PACKAGES = ("robosuite==1.5.2", "mujoco==3.3.7")
WIDTH, HEIGHT = 320, 240

PEER = f"""
import sys, time
import robosuite
env = robosuite.make(
    "NutAssemblySquare", robots="Panda", has_renderer=False, has_offscreen_renderer=True, use_camera_obs=True,
    camera_names=["frontview", "robot0_eye_in_hand"], camera_widths={WIDTH}, camera_heights={HEIGHT},
)
env.reset()
print("ready", flush=True)
for line in sys.stdin:
    pairs = int(line)
    start = time.process_time()
    for _ in range(pairs):
        images = [
            env.sim.render(camera_name=camera, width={WIDTH}, height={HEIGHT})
            for camera in ("frontview", "robot0_eye_in_hand")
        ]
    took = 1000 * (time.process_time() - start) / pairs
    # A context that was lost gives the same image again and again, in no time.
    assert images[0].std() > 10 < images[1].std() and (images[0] != images[1]).mean() > 0.5
    print("took", took, flush=True)
"""


def main() -> None:
    """Take turns, then print what a pair took."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--environment", type=Path, default=Path("/tmp/robosuite"))
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--pairs", type=int, default=5)
    options = parser.parse_args()
    views = [View.model_validate({"camera": each, "width": WIDTH, "height": HEIGHT}) for each in CAMERAS]
    with Peer(installed(options.environment)) as peer, AssemblyEnv("one_leg") as env:
        env.reset(seed=0)
        draw: dict[str, Callable[[int], float]] = {
            "robosuite": peer.pair_ms,
            "juicer": lambda pairs: pair_ms(lambda: [env.render_view(each) for each in views], pairs),
            "juicer, for people": lambda pairs: pair_ms(
                lambda: [env.render_camera(each, WIDTH, HEIGHT) for each in CAMERAS], pairs
            ),
        }
        spent: dict[str, list[float]] = {name: [] for name in draw}
        for count in range(options.rounds + 1):
            for name, each in draw.items():
                took = each(options.pairs)
                # The first round makes what the others use.
                if count:
                    spent[name].append(took)
    print(f"CPU ms a pair of {WIDTH}x{HEIGHT} images, median of {options.rounds} rounds (smallest to largest)")
    theirs = median(spent["robosuite"])
    for name, times in spent.items():
        ratio = f"robosuite takes {theirs / median(times):.1f} times as long" if name != "robosuite" else ""
        print(f"{name:<20} {median(times):7.2f}   ({min(times):.2f} to {max(times):.2f})   {ratio}")


def pair_ms(draw: Callable[[], object], pairs: int) -> float:
    """CPU milliseconds of one of our pairs."""
    start = time.process_time()
    for _ in range(pairs):
        draw()
    return 1000 * (time.process_time() - start) / pairs


class Peer:
    """A process of robosuite that draws when it is told to."""

    def __init__(self, python: Path) -> None:
        """Start it, and wait until it is ready."""
        # It makes its own choice of OpenGL; of those it offers, some lose their context.
        bare = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "MUJOCO_GL")}
        self._process = subprocess.Popen(
            [python, "-c", PEER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=bare
        )
        self._answer("ready")

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()

    def pair_ms(self, pairs: int) -> float:
        """CPU milliseconds of one of its pairs."""
        assert self._process.stdin is not None
        print(pairs, file=self._process.stdin, flush=True)
        return float(self._answer("took")[0])

    def _answer(self, word: str) -> list[str]:
        assert self._process.stdout is not None
        # Whatever else it prints is passed over.
        for line in self._process.stdout:
            first, *rest = line.split() or [""]
            if first == word:
                return rest
        sys.exit("robosuite ended without an answer; its reason is above")


def installed(folder: Path) -> Path:
    """Python of an environment with robosuite, made if it is not there."""
    python = folder / "bin" / "python"
    if not (folder / "lib").is_dir():
        venv.create(folder, with_pip=True)
    subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
    return python


if __name__ == "__main__":
    main()
