"""Processes that draw end with whoever started them, and their end is not waited for for ever."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from juicer.errors import ConfigError, InvalidEpisode, RenderingUnavailable
from juicer.imaging.processes import DrawingProcesses, Scenes
from juicer.sim.env import AssemblyEnv
from juicer.views import View

VIEW = View(camera="wrist", width=16, height=16)
KILLED = """
import os, signal
from juicer.imaging.processes import DrawingProcesses
from juicer.views import View

if __name__ == "__main__":
    processes = DrawingProcesses("one_leg", [View(camera="wrist", width=16, height=16)], 1)
    print(processes.pids[0], flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(scope="module")
def scenes(drawing) -> Scenes:
    env = AssemblyEnv("one_leg")
    env.reset(seed=0)
    end_effector = env.observation()["proprioception"][None, :3]
    return Scenes(env.data.qpos[None].copy(), end_effector)


def test_batches_come_back_in_their_order(scenes):
    batches = [
        Scenes(np.repeat(scenes.positions, count, 0), np.repeat(scenes.end_effector, count, 0))
        for count in (3, 1, 2, 5, 1, 1, 4)
    ]
    with DrawingProcesses("one_leg", [VIEW], workers=2) as processes:
        assert [len(images[VIEW.name]) for images in processes.draw(iter(batches))] == [3, 1, 2, 5, 1, 1, 4]


def test_a_process_that_may_start_no_others_draws_the_same_itself(scenes, monkeypatch):
    with DrawingProcesses("one_leg", [VIEW], workers=1) as processes:
        (images,) = processes.draw([scenes])
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)
    with DrawingProcesses("one_leg", [VIEW], workers=1) as processes:
        (own,) = processes.draw([scenes])
        assert processes.pids == ()
    np.testing.assert_array_equal(own[VIEW.name], images[VIEW.name])


def test_a_process_that_dies_is_told(scenes):
    with DrawingProcesses("one_leg", [VIEW], workers=1) as processes:
        os.kill(processes.pids[0], signal.SIGKILL)
        for _ in range(2):
            with pytest.raises(RenderingUnavailable, match=r"ended before its work was done: .*memory, or .*__main__"):
                list(processes.draw([scenes] * 3))


def test_what_fails_in_a_process_is_raised_here(scenes):
    with (
        pytest.raises(ConfigError, match="unknown task 'two_legs'"),
        DrawingProcesses("two_legs", [VIEW], 1) as processes,
    ):
        list(processes.draw([scenes]))


def test_what_failed_is_told_also_if_batches_are_slow(scenes):
    gaze = View(camera="front", crop={"kind": "gaze"}, width=16, height=16)
    nowhere = Scenes(scenes.positions, np.full_like(scenes.end_effector, np.nan))

    def slow():
        for _ in range(3):
            yield nowhere
            time.sleep(0.5)

    with DrawingProcesses("one_leg", [gaze], 1) as processes, pytest.raises(InvalidEpisode):
        list(processes.draw(slow()))


def test_mujoco_writes_no_log_of_its_warnings_where_images_are_drawn(tmp_path):
    script = (
        "import mujoco, numpy as np, juicer.imaging.processes\n"
        'model = mujoco.MjModel.from_xml_string(\'<mujoco><worldbody><body><freejoint/><geom size="1"/></body>'
        "</worldbody></mujoco>')\n"
        "data = mujoco.MjData(model)\n"
        "data.qpos[:] = np.nan\n"
        "mujoco.mj_step(model, data)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=100
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("drawing")
def test_they_end_with_the_process_that_started_them_whatever_ends_it(tmp_path):
    script = tmp_path / "killed.py"
    script.write_text(KILLED)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    killed = subprocess.run([sys.executable, str(script)], env=environment, capture_output=True, text=True, timeout=100)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    place = Path("/proc") / killed.stdout.strip()
    for _ in range(300):
        if not place.exists() or "Z" in (place / "stat").read_text().rpartition(")")[2][:3]:
            return
        time.sleep(0.1)
    pytest.fail("it is still there")
