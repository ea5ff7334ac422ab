"""The threads are honest: they hold against a push, give way to a turn, and let go when turned back."""

import numpy as np
import pytest

from juicer.episode import Outcome


@pytest.mark.parametrize("leg_yaw_deg", range(-120, 181, 60))
def test_pushing_the_held_leg_straight_down_does_not_assemble_it(leg_over_hole, leg_yaw_deg):
    scene = leg_over_hole(np.deg2rad(leg_yaw_deg), height_m=0.026)
    for _ in range(30):
        below = np.array([*scene.hole[:2], scene.hand()[2] - 0.5])
        *_, info = scene.env.step(scene.action(below, scene.hand_yaw, grip=1.0))
        assert info["outcome"] is not Outcome.SUCCESS


@pytest.mark.parametrize("leg_yaw_deg", range(-150, 181, 30))
def test_pressing_with_the_palm_does_not_assemble_it(leg_over_hole, leg_yaw_deg):
    scene = leg_over_hole(np.deg2rad(leg_yaw_deg), height_m=0.026)
    scene.lower(4)
    scene.release()
    for _ in range(40):
        below = np.array([*scene.hole[:2], scene.hand()[2] - 0.5])
        *_, info = scene.env.step(scene.action(below, scene.hand_yaw, grip=-1.0))
        assert info["outcome"] is not Outcome.SUCCESS


def test_a_held_leg_touches_the_gripper_and_nothing_else(leg_over_hole):
    scene = leg_over_hole(0.0, height_m=0.05)
    scene.env.step(scene.action(scene.hand(), scene.hand_yaw, grip=1.0))
    touching = {pair for pair in scene.env.contact_pairs() if "square_table_leg4" in pair}
    assert touching == {("gripper", "square_table_leg4")}


@pytest.mark.parametrize("leg_yaw_deg", range(0, 181, 60))
def test_a_dropped_in_leg_stands_on_its_thread_above_the_seat(leg_over_hole, leg_yaw_deg):
    scene = leg_over_hole(np.deg2rad(leg_yaw_deg), height_m=0.026)
    scene.lower(14)
    scene.release()
    height, _, tilt = scene.leg()
    assert 0.005 < height < 0.016
    assert tilt < np.deg2rad(25)  # the play of a bare shaft in the bore, where the bead leaves it room
    assert scene.env.data.contact.dist.min(initial=0) > -0.0005


def test_turning_clockwise_screws_the_leg_home_and_turning_back_lifts_it(leg_over_hole):
    scene = leg_over_hole(0.0, height_m=0.026)
    scene.lower(14)
    scene.release()
    for _ in range(9):
        if scene.env._info()["outcome"] is Outcome.SUCCESS:
            break
        scene.turn(np.deg2rad(-95))
    assert scene.env._info()["outcome"] is Outcome.SUCCESS
    seated, _, tilt = scene.leg()
    assert abs(seated) < 0.002
    assert tilt < np.deg2rad(3)
    for _ in range(3):
        scene.turn(np.deg2rad(90))
    assert scene.leg()[0] > seated + 0.003


def test_a_state_in_mid_screw_continues_exactly(leg_over_hole):
    scene = leg_over_hole(0.0, height_m=0.026)
    scene.lower(14)
    scene.release()
    scene.turn(np.deg2rad(-60))
    start, rng = scene.env.get_state(), np.random.default_rng(0)
    actions = [
        scene.action(scene.hand() + rng.normal(0, 0.004, 3), scene.hand_yaw + 0.02 * step, grip=1.0)
        for step in range(50)
    ]

    def replay(env):
        env.set_state(start)
        states = []
        for action in actions:
            env.step(action)
            states.append(env.get_state())
        return np.array(states)

    first = replay(scene.env)
    fresh = type(scene.env)()
    fresh.reset(seed=7)
    assert np.abs(replay(fresh) - first).max() == 0.0
    assert np.abs(replay(scene.env) - first).max() == 0.0
