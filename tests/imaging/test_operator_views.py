"""What an operator sees shows where the gripper is, and changes nothing of what a policy sees."""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.errors import ConfigError
from juicer.imaging.operator_views import OperatorRenderer, OperatorView
from juicer.imaging.renderer import ViewRenderer
from juicer.sim.env import AssemblyEnv
from juicer.views import GazeCrop, View

WIDTH, HEIGHT = 320, 240
POLICY_VIEWS = (View(camera="front"), View(camera="wrist"), View(camera="front", crop=GazeCrop()))


@pytest.fixture(scope="module")
def env() -> AssemblyEnv:
    env = AssemblyEnv("one_leg")
    env.reset(seed=0)
    return env


@pytest.fixture(scope="module")
def operator() -> Iterator[OperatorRenderer]:
    renderer = OperatorRenderer("one_leg")
    yield renderer
    renderer.close()


def red(image: NDArray[np.uint8]) -> NDArray[np.bool_]:
    colours = image.astype(int)
    return (colours[..., 0] > 150) & (colours[..., 1] < 70) & (colours[..., 2] < 70)


def blue(image: NDArray[np.uint8]) -> NDArray[np.bool_]:
    colours = image.astype(int)
    return (colours[..., 2] > 200) & (colours[..., 0] < 110) & (colours[..., 1] > 120)


def seen_by_policies(env: AssemblyEnv) -> list[bytes]:
    renderer = ViewRenderer("one_leg")
    end_effector = env.observation()["proprioception"][:3]
    images = [renderer.draw(env.data.qpos, view, end_effector) for view in POLICY_VIEWS]
    renderer.close()
    assert not any(red(image).any() for image in images)
    return [image.tobytes() for image in images]


def test_images_of_policies_are_the_same_bytes_whatever_the_operator_is_shown(env: AssemblyEnv) -> None:
    alone = seen_by_policies(env)
    operator = OperatorRenderer("one_leg")
    for view in OperatorView:
        operator.draw(env.data.qpos, view, WIDTH, HEIGHT, shadows=True)
        assert seen_by_policies(env) == alone
    operator.close()
    assert seen_by_policies(env) == alone


@pytest.mark.parametrize("view", OperatorView)
def test_every_view_shows_a_red_line_out_of_the_gripper(
    env: AssemblyEnv, operator: OperatorRenderer, view: OperatorView
) -> None:
    image = operator.draw(env.data.qpos, view, WIDTH, HEIGHT)
    assert image.shape == (HEIGHT, WIDTH, 3)
    assert red(image).sum() > 10


def test_the_line_straight_down_is_in_the_middle_of_the_view_from_the_side(
    env: AssemblyEnv, operator: OperatorRenderer
) -> None:
    image = operator.draw(env.data.qpos, OperatorView.SIDE, WIDTH, HEIGHT)
    rows, columns = np.nonzero(blue(image) & (np.abs(np.arange(WIDTH) - WIDTH / 2) < 20))
    assert len(rows) > 10
    np.testing.assert_allclose(columns, WIDTH / 2, atol=2)


def test_lines_can_be_left_out(env: AssemblyEnv, operator: OperatorRenderer) -> None:
    shown, plain = (
        operator.draw(env.data.qpos, OperatorView.FRONT, WIDTH, HEIGHT, lines=each) for each in (True, False)
    )
    assert not red(plain).any()
    assert not blue(plain).any()
    assert (shown != plain).any(axis=-1).mean() < 0.02


def test_shadows_are_drawn_if_they_are_asked_for(env: AssemblyEnv, operator: OperatorRenderer) -> None:
    plain = operator.draw(env.data.qpos, OperatorView.FRONT, WIDTH, HEIGHT)
    shadowed = operator.draw(env.data.qpos, OperatorView.FRONT, WIDTH, HEIGHT, shadows=True)
    darker = shadowed.astype(int).sum(axis=2) < plain.astype(int).sum(axis=2) - 20
    assert 0.001 < darker.mean() < 0.3


def test_an_image_depends_on_the_joint_positions_alone(env: AssemblyEnv, operator: OperatorRenderer) -> None:
    first = operator.draw(env.data.qpos, OperatorView.WRIST, WIDTH, HEIGHT)
    for view in OperatorView:
        operator.draw(env.data.qpos * 1.01, view, 2 * WIDTH, 2 * HEIGHT, shadows=True)
    np.testing.assert_array_equal(operator.draw(env.data.qpos, OperatorView.WRIST, WIDTH, HEIGHT), first)


def test_an_unknown_task_is_said_in_a_sentence() -> None:
    with pytest.raises(ConfigError, match="two_legs"):
        OperatorRenderer("two_legs")
