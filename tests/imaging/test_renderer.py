"""Pictures for every thread, on every machine that can draw, in whatever order things are imported and closed."""

from __future__ import annotations

import copy
import gc
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import AddRenderObservation, RecordVideo

from juicer.errors import ConfigError
from juicer.sim.env import AssemblyEnv
from juicer.sim.registration import environment_id
from juicer.sim.vector import AssemblyVectorEnv

ACTION = np.array([0.5, 0.15, 0.02, 0, 1, 0, 1, 0, 0, 1], dtype=np.float32)


@pytest.fixture
def env():
    env = AssemblyEnv(render_mode="rgb_array")
    env.reset(seed=0)
    yield env
    env.close()


def render_threads() -> int:
    return sum(thread.name == "renderer" for thread in threading.enumerate())


def run(script: str, **surroundings: str) -> subprocess.CompletedProcess[str]:
    bare = {name: value for name, value in os.environ.items() if name not in {"DISPLAY", "MUJOCO_GL"}}
    command = [sys.executable, "-c", script]
    return subprocess.run(command, env=bare | surroundings, capture_output=True, text=True, timeout=120)


def test_every_thread_gets_the_same_picture(env: AssemblyEnv):
    mine = env.render()
    assert mine.shape == (480, 640, 3)
    assert mine.std() > 10
    with ThreadPoolExecutor(3) as threads:
        for picture in threads.map(lambda _: env.render(), range(6)):
            np.testing.assert_array_equal(picture, mine)


def test_many_environments_draw_at_the_same_time():
    envs = [AssemblyEnv() for _ in range(4)]
    for seed, env in enumerate(envs):
        env.reset(seed=seed)
    alone = [env.render_camera("wrist", 64, 48) for env in envs]
    with ThreadPoolExecutor(4) as threads:
        for _ in range(3):
            together = list(threads.map(lambda env: env.render_camera("wrist", 64, 48), envs))
            np.testing.assert_array_equal(together, alone)
    for env in envs:
        env.close()


def test_a_picture_is_an_array_of_its_own(env: AssemblyEnv):
    first = env.render()
    kept = first.copy()
    env.render_camera("wrist", 64, 48)
    np.testing.assert_array_equal(first, kept)
    first[:] = 0
    np.testing.assert_array_equal(env.render(), kept)


def test_closing_twice_and_drawing_afterwards_do_no_harm():
    before = render_threads()
    with AssemblyEnv() as env:
        env.reset(seed=0)
        picture = env.render()
        assert render_threads() == before + 1
    assert render_threads() == before
    env.close()
    np.testing.assert_array_equal(env.render(), picture)
    env.close()
    assert render_threads() == before


def test_closing_one_environment_leaves_those_of_the_same_task_their_images():
    before = render_threads()
    with AssemblyEnv() as one, AssemblyEnv() as other:
        one.reset(seed=0)
        other.reset(seed=1)
        picture = other.render_camera("front", 64, 48)
        one.render_camera("front", 64, 48)
        one.close()
        np.testing.assert_array_equal(other.render_camera("front", 64, 48), picture)
    assert render_threads() == before


def test_an_environment_that_nobody_closed_leaves_no_thread():
    before = {thread for thread in threading.enumerate() if thread.name == "renderer"}
    env = AssemblyEnv()
    env.reset(seed=0)
    env.render()
    (thread,) = {thread for thread in threading.enumerate() if thread.name == "renderer"} - before
    del env
    gc.collect()
    thread.join(timeout=30)
    assert not thread.is_alive()


def test_original_and_copy_draw_each_for_itself(env: AssemblyEnv):
    picture = env.render()
    twin = copy.deepcopy(env)
    env.close()
    np.testing.assert_array_equal(twin.render(), picture)
    twin.close()


def test_what_diverged_can_still_be_drawn(env: AssemblyEnv):
    env.data.qvel[:] = np.nan
    env.step(ACTION)
    assert env.render().shape == (480, 640, 3)


@pytest.mark.parametrize(
    ("camera", "width", "height", "problem"),
    [
        ("frnot", 64, 48, "unknown camera 'frnot'; did you mean 'front'"),
        (0, 64, 48, "unknown camera 0"),
        ("front", 0, 48, "1x1 to 1280x720 pixels, got 0x48"),
        ("front", 64, -1, "got 64x-1"),
        ("front", 1281, 48, "got 1281x48"),
        ("front", 64, 721, "got 64x721"),
        ("front", 64.5, 48, "got 64.5x48"),
        ("front", True, 48, "got Truex48"),
        ("front", "64", 48, "got '64'x48"),
    ],
)
def test_a_picture_that_cannot_be_is_refused(env: AssemblyEnv, camera: Any, width: Any, height: Any, problem: str):
    with pytest.raises(ConfigError, match=problem):
        env.render_camera(camera, width, height)


def test_numpys_numbers_are_sizes_too(env: AssemblyEnv):
    assert env.render_camera("front", np.int64(64), np.uint16(48)).shape == (48, 64, 3)


def test_a_vector_environment_draws_a_tuple_of_pictures():
    envs = gymnasium.make_vec(environment_id("one_leg"), num_envs=2, render_mode="rgb_array")
    envs.reset(seed=0)
    first, second = envs.render()
    assert first.shape == second.shape == (480, 640, 3)
    assert not np.array_equal(first, second)
    assert envs.render_mode == "rgb_array"
    envs.close()
    envs.close()


def test_gymnasiums_wrappers_get_pictures(env: AssemblyEnv):
    shown, _ = AddRenderObservation(env).reset(seed=0)
    np.testing.assert_array_equal(shown, env.render())
    listing = gymnasium.make(environment_id("one_leg"), render_mode="rgb_array_list")
    listing.reset(seed=0)
    listing.step(ACTION)
    assert len(listing.render()) == 2
    listing.close()
    batch = gymnasium.wrappers.vector.RecordEpisodeStatistics(AssemblyVectorEnv(2, max_steps=1))
    batch.reset(seed=0)
    assert batch.step(np.tile(ACTION, (2, 1)))[4]["episode"]["l"].tolist() == [1, 1]
    batch.close()


def test_gymnasium_records_a_video(tmp_path: Path):
    pytest.importorskip("moviepy", reason="needs the extra 'video'")
    with RecordVideo(gymnasium.make(environment_id("one_leg"), render_mode="rgb_array"), str(tmp_path)) as env:
        env.reset(seed=0)
        for _ in range(3):
            env.step(ACTION)
    assert [path.suffix for path in tmp_path.iterdir()] == [".mp4"]


@pytest.mark.parametrize(
    "imports",
    [
        "import mujoco\nfrom juicer.sim.env import AssemblyEnv",
        "from juicer.sim.env import AssemblyEnv",
        "import mujoco, mujoco.viewer\nimport juicer.sim.registration\nfrom juicer.sim.env import AssemblyEnv",
        "import mujoco, os\nos.environ['MUJOCO_GL'] = 'egl'\nfrom juicer.sim.env import AssemblyEnv",
    ],
)
def test_drawing_needs_neither_display_nor_settings_nor_an_order_of_imports(imports: str):
    done = run(f"{imports}\nenv = AssemblyEnv()\nenv.reset(seed=0)\nassert env.render().std() > 10")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("first", ["import gymnasium, mujoco", "from juicer import api"])
def test_gymnasium_finds_and_draws_an_environment_by_its_name_alone(first: str):
    done = run(
        f"{first}\nimport gymnasium\n"
        "env = gymnasium.make('juicer.sim.registration:juicer/OneLeg-v0', render_mode='rgb_array')\n"
        "env.reset(seed=0)\nassert env.render().std() > 10"
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("setting", ["off", "osmesa"])
def test_a_machine_that_cannot_draw_says_how_to_mend_it(setting: str):
    script = (
        "from juicer.errors import RenderingUnavailable\n"
        "from juicer.sim.env import AssemblyEnv\n"
        "env = AssemblyEnv()\n"
        "env.reset(seed=0)\n"
        "for _ in range(2):\n"
        "    try:\n"
        "        env.render()\n"
        "    except RenderingUnavailable as error:\n"
        "        print(error)\n"
        "    else:\n"
        "        print('set MUJOCO_GL=egl')\n"
    )
    done = run(script, MUJOCO_GL=setting)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("set MUJOCO_GL=egl") == 2


FORK = """
import os
from juicer.errors import RenderingUnavailable
from juicer.sim.env import AssemblyEnv
env = AssemblyEnv()
env.reset(seed=0)
if {drawn_before}:
    env.render()
child = os.fork()
if child == 0:
    for drawing in (env, AssemblyEnv()):
        drawing.reset(seed=0)
        try:
            print(drawing.render().shape, flush=True)
        except RenderingUnavailable as error:
            print(error, flush=True)
        drawing.close()
    os._exit(0)
os.waitpid(child, 0)
"""


def test_a_forked_process_draws_unless_its_parent_did():
    done = run(FORK.format(drawn_before=False))
    assert done.stdout.count("(480, 640, 3)") == 2, done.stderr
    done = run(FORK.format(drawn_before=True))
    assert done.stdout.count("was forked from one that had drawn images") == 2, done.stderr


def test_environments_in_other_processes_draw():
    envs = gymnasium.make_vec(
        environment_id("one_leg"), num_envs=2, vectorization_mode="async", render_mode="rgb_array",
        vector_kwargs={"context": "spawn"},
    )  # fmt: skip
    envs.reset(seed=0)
    assert [picture.shape for picture in envs.render()] == [(480, 640, 3)] * 2
    envs.close()
