"""Draw the images of README.md from demonstrations in a store.

For each task: juicer stage record --config laptop --set task=TASK --set record.demonstrations=1, then the stage ingest
likewise, which prints the id. Then, after make looks, with the four ids in the order of TASKS:

MUJOCO_GL=egl python scripts/draw_readme_images.py ID ID ID ID [--store data]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from juicer import api
from juicer.episode import Episode
from juicer.imaging.renderer import look_for_people
from juicer.imaging.visual_model import visual_spec
from juicer.tasks.registry import get_task

TASKS = ("one_leg", "round_table", "lamp", "square_table")
FOLDER = Path(__file__).parents[1] / "docs" / "images"
STRIDE = 3
"""Control steps of 0.1 s between two frames of the animation, which shows ten frames a second."""


def main() -> None:
    """Draw an animation of the first task, and an image of all four assembled."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("episodes", nargs=len(TASKS), metavar="ID")
    parser.add_argument("--store", default="data")
    options = parser.parse_args()
    store = api.open_store(options.store)
    episodes = [api.load_episodes(store, each).read(0) for each in options.episodes]
    FOLDER.mkdir(exist_ok=True)
    write_animation(FOLDER / "one_leg.webp", episodes[0])
    write_row(FOLDER / "tasks.jpg", episodes)


def write_animation(path: Path, episode: Episode) -> None:
    """The whole episode, three times as fast as it was; its end stays for a second and a half."""
    states = [*episode.steps["sim_state"][::STRIDE], episode.final["sim_state"]]
    frames = list(draw(episode.record.task, states, width=480, height=320, distance=0.85))
    pauses = [100] * (len(frames) - 1) + [1500]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=pauses, loop=0, quality=70, method=6)


def write_row(path: Path, episodes: Iterable[Episode]) -> None:
    """The last state of each episode, side by side."""
    images = [
        np.asarray(image)
        for episode in episodes
        for image in draw(episode.record.task, [episode.final["sim_state"]], width=320, height=300, distance=0.62)
    ]
    Image.fromarray(np.concatenate(images, axis=1)).save(path, quality=88)


def draw(task: str, states: Iterable[np.ndarray], width: int, height: int, distance: float) -> Iterator[Image.Image]:
    """Images of states as films show them, drawn at twice their size, from beside the robot's front.

    Args:
        task: Assembly task.
        states: Simulator states.
        width: Of an image [pixels].
        height: Of an image [pixels].
        distance: From the camera to the middle of the fence [m].
    """
    spec = visual_spec(get_task(task), look_for_people())
    spec.visual.quality.shadowsize = 4096
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 2 * width, 2 * height
    model = spec.compile()
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (0.58, 0.0, 0.09)
    camera.distance, camera.azimuth, camera.elevation = distance, 165, -35
    with api.make(task) as env, mujoco.Renderer(model, 2 * height, 2 * width) as renderer:
        for state in states:
            env.set_state(np.asarray(state, dtype=np.float64))
            data.qpos[:] = env.data.qpos
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera)
            yield Image.fromarray(renderer.render()).resize((width, height), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    main()
