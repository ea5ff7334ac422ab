import math
from dataclasses import replace

import numpy as np
import pytest

from juicer.geometry import matrix_to_rotvec, rotvec_to_matrix
from juicer.sim.env import STEP_S
from juicer.teleoperation.controls import (
    FASTEST_M_S,
    FASTEST_RAD_S,
    GAMEPAD_DEAD_ZONE,
    Action,
    ControllerState,
    Controls,
    responded,
)
from juicer.teleoperation.key_maps import PRESETS, KeyMap, Speeds

NOTHING = ControllerState(source="keyboard", sequence=0)


def holding(*keys: str) -> ControllerState:
    return replace(NOTHING, held=frozenset(keys))


def pressed(**edges: int) -> ControllerState:
    return replace(NOTHING, edges=edges)


def moved(*delta: float, closings: int = 1, clutch: bool = True) -> ControllerState:
    pose = (*delta, *[0.0] * (6 - len(delta)))
    return replace(NOTHING, source="pose", pose_delta=pose, clutch=clutch, edges={"clutch": closings})


def test_nothing_held_means_nothing() -> None:
    intent = Controls().intent(NOTHING)
    assert not intent.moves
    assert not intent.presses
    assert not intent.slow


@pytest.mark.parametrize(
    ("key", "twist"),
    [
        ("KeyW", (-0.1, 0, 0, 0, 0, 0)),
        ("KeyS", (0.1, 0, 0, 0, 0, 0)),
        ("KeyA", (0, -0.1, 0, 0, 0, 0)),
        ("KeyD", (0, 0.1, 0, 0, 0, 0)),
        ("KeyQ", (0, 0, -0.1, 0, 0, 0)),
        ("KeyE", (0, 0, 0.1, 0, 0, 0)),
        ("KeyJ", (0, 0, 0, 2, 0, 0)),
        ("KeyI", (0, 0, 0, 0, -2, 0)),
        ("KeyU", (0, 0, 0, 0, 0, 2)),
    ],
)
def test_a_held_key_moves_as_in_the_original_by_a_centimetre_or_a_fifth_of_a_radian_a_step(
    key: str, twist: tuple[float, ...]
) -> None:
    assert Controls().intent(holding(key)).twist == pytest.approx(twist)


def test_opposite_keys_cancel_and_two_keys_for_one_direction_count_once() -> None:
    assert not Controls().intent(holding("KeyW", "KeyS")).moves
    doubled = KeyMap("doubled", {**PRESETS["original"].keys, "ArrowUp": PRESETS["original"].keys["KeyW"]}, {})
    assert Controls(doubled).intent(holding("KeyW", "ArrowUp")).twist[0] == pytest.approx(-0.1)


def test_shift_makes_everything_four_times_slower() -> None:
    intent = Controls().intent(holding("KeyW", "KeyU", "ShiftLeft"))
    assert intent.slow
    assert intent.twist == pytest.approx((-0.025, 0, 0, 0, 0, 0.5))
    fast = replace(NOTHING, source="spacemouse", twist=(0, 1.0, 0, 0, 0, 0), held=frozenset({"ShiftLeft"}))
    assert Controls().intent(fast).twist[0] == pytest.approx(FASTEST_M_S / 4)


def test_slow_mode_may_stay_until_the_next_press() -> None:
    controls = Controls(replace(PRESETS["original"], speeds=Speeds(slow_stays=True)))
    assert [controls.intent(pressed(ShiftLeft=count)).slow for count in (0, 1, 1, 2)] == [False, True, True, False]


def test_a_repeated_state_presses_once_and_a_lost_one_loses_no_press() -> None:
    controls = Controls()
    assert controls.intent(pressed(KeyZ=1)).presses == {Action.GRIPPER}
    assert not controls.intent(pressed(KeyZ=1)).presses
    # Two presses came in one state: they are two steps' presses.
    assert [controls.intent(pressed(KeyZ=1, KeyB=2)).presses for _ in range(3)] == [{Action.UNDO}, {Action.UNDO}, set()]


def test_another_key_map_makes_no_press_of_keys_that_were_pressed_before() -> None:
    controls = Controls()
    state = pressed(KeyF=3, KeyT=1)
    controls.intent(state)
    controls.key_map = replace(PRESETS["original"], keys={"KeyF": Action.DISCARD})
    assert not controls.intent(state).presses
    assert controls.intent(pressed(KeyF=4, KeyT=1)).presses == {Action.DISCARD}


def test_a_stick_has_a_round_dead_zone_and_reaches_full_speed_at_its_rim() -> None:
    inside = 0.99 * GAMEPAD_DEAD_ZONE / math.sqrt(2)
    np.testing.assert_array_equal(responded(np.array([inside, inside])), 0)
    np.testing.assert_allclose(responded(np.array([0.6, 0.8])), [0.6, 0.8])
    halfway = GAMEPAD_DEAD_ZONE + (1 - GAMEPAD_DEAD_ZONE) / 2
    np.testing.assert_allclose(responded(np.array([halfway, 0.0])), [0.5**3, 0.0])


@pytest.mark.parametrize(
    ("axes", "twist"),
    [
        ((1, 0, 0, 0, 0, 0), (0, 0.25, 0, 0, 0, 0)),
        ((0, 1, 0, 0, 0, 0), (0.25, 0, 0, 0, 0, 0)),
        ((0, 0, 1, 0, 0, 0), (0, 0, 0, -2, 0, 0)),
        ((0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 2, 0)),
        ((0, 0, 0, 0, 1, 0), (0, 0, -0.25, 0, 0, 0)),
        ((0, 0, 0, 0, 0, 1), (0, 0, 0.25, 0, 0, 0)),
    ],
)
def test_a_gamepad_moves_by_sticks_and_triggers(axes: tuple[float, ...], twist: tuple[float, ...]) -> None:
    assert Controls().intent(replace(NOTHING, source="gamepad", axes=axes)).twist == pytest.approx(twist)


def test_bumpers_turn_and_buttons_press() -> None:
    state = replace(NOTHING, source="gamepad", held=frozenset({"LB"}), edges={"A": 1, "Y": 1})
    intent = Controls().intent(state)
    assert intent.twist == pytest.approx((0, 0, 0, 0, 0, 2))
    assert intent.presses == {Action.GRIPPER, Action.SUCCESS}


def test_a_spacemouse_moves_as_in_the_original_within_its_limits_and_dead_zone() -> None:
    def twist(*given: float) -> tuple[float, ...]:
        return Controls().intent(replace(NOTHING, source="spacemouse", twist=given)).twist

    assert twist(0.1, 0, 0, 0, 0, 0) == pytest.approx((0, 0.08, 0, 0, 0, 0))
    assert twist(0, 0.1, 0, 0, 0, 0.1) == pytest.approx((0.08, 0, 0, 0, 0, -0.4))
    assert twist(0, 0, 0.1, 0.1, 0.2, 0) == pytest.approx((0, 0, -0.08, 0.8, 0.4, 0))
    assert twist(*[0.049] * 6) == (0.0,) * 6
    # The direction stays: the largest component is what is limited, and the length of a rotation.
    assert twist(0, 1.0, 0.5, 0, 0, 0) == pytest.approx((FASTEST_M_S, 0, -FASTEST_M_S / 2, 0, 0, 0))
    assert np.linalg.norm(twist(0, 0, 0, 1, 1, 1)[3:]) == pytest.approx(FASTEST_RAD_S)


def test_either_button_of_a_spacemouse_toggles_the_gripper() -> None:
    mouse = ControllerState(source="spacemouse", sequence=3, twist=(0.0,) * 6, edges={"Button1": 1})
    assert Controls().intent(holding("KeyW").with_spacemouse(mouse)).presses == {Action.GRIPPER}


def test_presses_of_a_device_from_before_the_connection_press_nothing() -> None:
    mouse = ControllerState(source="spacemouse", sequence=3, edges={"Button0": 5})
    controls = Controls(seen=mouse.edges)
    assert not controls.intent(NOTHING.with_spacemouse(mouse)).presses
    assert controls.intent(NOTHING.with_spacemouse(replace(mouse, edges={"Button0": 6}))).presses == {Action.GRIPPER}


def test_a_state_says_spacemouse_only_while_it_is_moved() -> None:
    mouse = ControllerState(source="spacemouse", sequence=3, twist=(0.0,) * 6)
    assert NOTHING.with_spacemouse(mouse).source == "keyboard"
    assert NOTHING.with_spacemouse(replace(mouse, twist=(0.0, 0.5, 0.0, 0.0, 0.0, 0.0))).source == "spacemouse"


def test_a_pose_device_is_followed_all_the_way_though_no_faster_than_the_limits() -> None:
    controls = Controls()
    controls.intent(moved(0, 0, 0))
    twists = [controls.intent(moved(0.06, 0, 0, 0, 0, 1.0)).twist for _ in range(6)]
    assert max(twist[0] for twist in twists) <= FASTEST_M_S
    np.testing.assert_allclose(STEP_S * np.sum(twists, axis=0), [0.06, 0, 0, 0, 0, 1.0], atol=1e-12)


def test_lost_states_of_a_pose_device_lose_no_motion_however_it_turns() -> None:
    controls = Controls()
    controls.intent(moved())
    pose = (0.01, 0, 0, 0.1, 0.2, -0.05)
    reached = np.eye(3)
    for state in (moved(0.02, 0, 0, 0.2, -0.1, 0.1), moved(*pose), moved(*pose), moved(*pose)):
        reached = rotvec_to_matrix(STEP_S * np.array(controls.intent(state).twist[3:])) @ reached
    np.testing.assert_allclose(matrix_to_rotvec(reached), pose[3:], atol=1e-9)


def test_a_pose_device_moves_nothing_while_its_clutch_is_open_or_was_closed_anew() -> None:
    controls = Controls()
    assert not controls.intent(moved(0.3, 0, 0, clutch=False)).moves
    assert not controls.intent(moved(0.3, 0, 0)).moves
    assert controls.intent(moved(0.31, 0, 0)).moves
    assert not controls.intent(moved(0.1, 0, 0, closings=2)).moves


def test_a_pose_device_that_was_not_heard_of_does_not_make_the_robot_jump() -> None:
    controls = Controls()
    controls.intent(moved())
    controls.release()
    assert not controls.intent(moved(0.3, 0, 0)).moves


def test_slow_mode_makes_a_pose_device_count_a_quarter() -> None:
    controls = Controls()
    controls.intent(moved())
    state = replace(moved(0.04, 0, 0), held=frozenset({"slow"}))
    assert controls.intent(state).twist[0] * STEP_S == pytest.approx(0.01)
