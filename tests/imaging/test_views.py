"""A view shows what it says, to the pixel, and the same bytes whenever and wherever a state is drawn."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.errors import ConfigError, InvalidEpisode
from juicer.imaging.cameras import Frustum
from juicer.observer import Observer, image
from juicer.sim.env import AssemblyEnv
from juicer.views import GazeCrop, StaticCrop, View

TASKS = ("one_leg", "round_table", "lamp", "square_table")
LEFT_HALF = StaticCrop(right=0.5)
VIEWS = (
    View(camera="front", width=64, height=48),
    View(camera="front", crop=StaticCrop(left=0.2, right=0.8, top=0.4, bottom=0.9), width=128, height=64),
    View(camera="front", crop=GazeCrop()),
    View(camera="wrist", supersampling=2),
    View(camera="wrist", crop=LEFT_HALF, width=40, height=30),
)
HALF_HEIGHT = np.tan(np.radians(42.56 / 2))

pytestmark = pytest.mark.usefixtures("drawing")


def drawn(env: AssemblyEnv) -> list[str]:
    return [hashlib.sha256(env.render_view(view).tobytes()).hexdigest() for view in VIEWS]


def moving(task: str) -> tuple[list[NDArray[np.float64]], list[list[str]]]:
    """States of an episode, and what was drawn when they were reached."""
    with AssemblyEnv(task) as env:
        observation, _ = env.reset(seed=3)
        goal = np.append(observation["proprioception"][:9], 1.0)
        states, images = [env.get_state()], [drawn(env)]
        for step in range(4):
            goal[:3] += (0.01, -0.02, -0.015)
            goal[9] = (-1.0) ** step
            env.step(goal.astype(np.float32))
            states.append(env.get_state())
            images.append(drawn(env))
    return states, images


ELSEWHERE = """
import sys
import numpy as np
from juicer.sim.env import AssemblyEnv
from tests.imaging.test_views import TASKS, drawn
states = np.load(sys.argv[1])
for task in TASKS:
    with AssemblyEnv(task) as env:
        for state in states[task]:
            env.set_state(state)
            print(*drawn(env))
"""


def test_a_restored_state_gives_the_bytes_that_were_drawn_when_it_happened_here_and_in_another_process(tmp_path: Path):
    happened = {task: moving(task) for task in TASKS}
    expected = []
    for task, (states, images) in happened.items():
        expected += images
        with AssemblyEnv(task) as env:
            for state, before in zip(reversed(states), reversed(images), strict=True):
                env.set_state(state)
                assert drawn(env) == before
        # Every state looks different, in every view.
        assert all(len(set(view)) == len(states) for view in zip(*images, strict=True))
    file = tmp_path / "states.npz"
    np.savez(file, **{task: np.array(states) for task, (states, _) in happened.items()})
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", ELSEWHERE, str(file)],
        env=os.environ | {"PYTHONPATH": str(root)}, cwd=root, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert [line.split() for line in done.stdout.splitlines()] == expected, done.stderr


def test_images_of_a_policy_are_plain_and_those_of_the_view_of_the_whole():
    with AssemblyEnv() as env:
        env.reset(seed=0)
        for camera in ("front", "wrist"):
            seen = Observer([image(camera, 80, 60)]).see(env)[camera]
            view = View.model_validate({"camera": camera, "width": 80, "height": 60})
            np.testing.assert_array_equal(seen, env.render_view(view))
            assert not np.array_equal(seen, env.render_camera(camera, 80, 60))


@pytest.mark.parametrize("size", [(0, 60), (1281, 60), (80, 721)])
def test_a_policy_cannot_ask_for_an_image_that_cannot_be(size: tuple[int, int]):
    with pytest.raises(ConfigError, match=r"1x1 to 1280x720|width must be"):
        image("front", *size)


def leg_in_the_air(env: AssemblyEnv, middle: NDArray[np.float64]) -> None:
    """Puts the orange leg, whose colour nothing else has, somewhere, lying across what the front camera sees."""
    address = env.model.joint("square_table_leg4").qposadr[0]
    # It is 87.5 mm long; from its origin, 56.25 of them lie on the side of its peg.
    env.data.qpos[address : address + 7] = (middle[0], middle[1] + 0.0125, middle[2], 1, 0, 0, 0)


def orange(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Middle of what is orange, in pixels from the left and the upper edge."""
    red, green, blue = picture.astype(int).transpose(2, 0, 1)
    rows, columns = np.nonzero((red > 1.4 * green) & (green > 1.4 * blue) & (red > 60))
    assert len(rows) > 4
    return np.array([columns.min() + columns.max() + 1, rows.min() + rows.max() + 1]) / 2


def seen_from_the_front(point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Tangents of the angles, to the right and up, at which FurnitureBench's front camera sees a point."""
    away = point - (1.20, 0, 0.22)
    depth = np.array([-0.983, 0, -0.181]) / np.hypot(0.983, 0.181) @ away
    up = np.array([-0.181, 0, 0.983]) / np.hypot(0.983, 0.181) @ away
    return np.array([away[1], up]) / depth


@pytest.mark.parametrize("position", [(0.45, -0.2, 0.12), (0.6, 0.1, 0.2), (0.4, 0.25, 0.05)])
def test_a_thing_is_seen_where_the_camera_s_calibration_says(position: tuple[float, float, float]):
    with AssemblyEnv() as env:
        env.reset(seed=0)
        env.data.qpos[1] -= 1.2  # the arm out of the way
        leg_in_the_air(env, np.array(position))
        right, up = seen_from_the_front(np.array(position)) / HALF_HEIGHT
        whole = env.render_view(View(camera="front", width=640, height=480))
        expected = np.array([320 + 240 * right, 240 - 240 * up])
        np.testing.assert_allclose(orange(whole), expected, atol=3)
        crop = StaticCrop(left=0.1, right=0.9, top=0.2, bottom=0.7)
        cropped = env.render_view(View(camera="front", crop=crop, width=512, height=240))
        np.testing.assert_allclose(orange(cropped), expected - (64, 96), atol=3)
        squeezed = env.render_view(View(camera="front", width=160, height=480))
        np.testing.assert_allclose(orange(squeezed), expected * (0.25, 1), atol=3)


def test_the_point_below_the_end_effector_is_in_the_middle_of_the_gaze_and_shown_at_its_scale():
    with AssemblyEnv() as env:
        env.reset(seed=0)
        end_effector = env.observation()["proprioception"][:3].astype(np.float64)
        leg_in_the_air(env, end_effector - (0, 0, 0.05))
        view = View(camera="front", crop=GazeCrop(below_m=0.05, reach_m=0.05), width=100, height=100)
        picture = env.render_view(view)
        np.testing.assert_allclose(orange(picture), (50, 50), atol=2)
        red, green, _ = picture.astype(int).transpose(2, 0, 1)
        # Ten centimetres are a hundred pixels.
        assert np.ptp(np.nonzero(red > 1.4 * green)[1]) == pytest.approx(87.5, abs=5)


def test_a_gaze_crop_keeps_its_shape_and_stays_within_what_the_camera_sees(rng: np.random.Generator):
    room = HALF_HEIGHT * 16 / 9, HALF_HEIGHT
    for _ in range(200):
        width, height = rng.integers(1, 720, 2)
        crop = GazeCrop(reach_m=rng.uniform(0.01, 1))
        view = View(camera="front", crop=crop, width=int(width), height=int(height))
        place = rng.choice([1e30, *rng.normal(0, 1, 6)], 3).astype(np.float32)
        left, right, bottom, top = Frustum.of_view(view, place)
        assert (right - left) / (top - bottom) == pytest.approx(width / height)
        assert max(-left, right) <= room[0] * (1 + 1e-9)
        assert max(-bottom, top) <= room[1] * (1 + 1e-9)


@pytest.mark.parametrize("lost", [np.nan, np.inf])
def test_a_gaze_crop_is_not_placed_by_what_is_no_number(lost):
    view = View(camera="front", crop=GazeCrop())
    with pytest.raises(InvalidEpisode, match="end effector's position is no finite number"):
        Frustum.of_view(view, np.array([0.5, lost, 0.1], np.float32))


def test_the_wrist_sees_sixteen_by_nine_squeezed_into_its_size():
    with AssemblyEnv() as env:
        env.reset(seed=0)
        wide = env.render_view(View(camera="wrist", width=320, height=180)).astype(int)
        square = env.render_view(View(camera="wrist", width=320, height=320)).astype(int)
        stretched = square[np.linspace(0, 319, 180).round().astype(int)]
        assert np.mean(np.abs(stretched - wide) > 30) < 0.05
        left = env.render_view(View(camera="wrist", crop=LEFT_HALF, width=160, height=180))
        assert np.mean(np.abs(left - wide[:, :160]) > 30) < 0.01


def test_supersampling_is_the_mean_of_squares():
    with AssemblyEnv() as env:
        env.reset(seed=0)
        fine = env.render_view(View(camera="front", width=128, height=96)).astype(float)
        coarse = env.render_view(View(camera="front", width=64, height=48, supersampling=2))
        np.testing.assert_allclose(coarse, fine.reshape(48, 2, 64, 2, 3).mean(axis=(1, 3)), atol=0.5)


def test_the_largest_view_with_the_most_samples_is_drawn():
    with AssemblyEnv() as env:
        env.reset(seed=0)
        small = env.render_view(View(camera="front", width=64, height=48))
        assert env.render_view(View(camera="front", width=1280, height=720, supersampling=4)).std() > 10
        np.testing.assert_array_equal(env.render_view(View(camera="front", width=64, height=48)), small)
