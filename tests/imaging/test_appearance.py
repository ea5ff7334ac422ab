"""Light and cameras that a shift changes: seen by policies, not by people, and the same from the same seed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.sim.env import AssemblyEnv
from juicer.views import GazeCrop, View

FRONT = View(camera="front", width=96, height=72)
WRIST = View(camera="wrist", width=96, height=54)
VIEWS = (FRONT, WRIST, View(camera="front", width=48, height=48, crop=GazeCrop()))


def seen(shift: Mapping[str, Any] | str | None, seed: int = 0, views: tuple[View, ...] = VIEWS) -> list[NDArray[Any]]:
    env = AssemblyEnv("one_leg", shift=shift)
    env.reset(seed=seed)
    try:
        return [env.render_view(view).astype(int) for view in views]
    finally:
        env.close()


@pytest.mark.parametrize("kind", ["light", "camera"])
def test_every_view_of_a_policy_differs_and_people_see_no_difference(kind: str):
    for shifted, usual in zip(seen(kind), seen(None), strict=True):
        assert np.abs(shifted - usual).mean() > 1
    env, plain = AssemblyEnv("one_leg", shift=kind), AssemblyEnv("one_leg")
    for each in (env, plain):
        each.reset(seed=0)
    np.testing.assert_array_equal(env.render_camera("front", 96, 72), plain.render_camera("front", 96, 72))


@pytest.mark.parametrize("kind", ["light", "camera"])
def test_a_seed_decides_what_is_seen(kind: str):
    (first,), (again,) = (seen(kind, 5, (WRIST,)) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    env = AssemblyEnv("one_leg", shift=kind)
    env.reset(seed=5)
    state = env.get_state()
    env.reset(seed=6)
    assert (env.render_view(WRIST) != first).any()
    env.set_state(state)
    np.testing.assert_array_equal(env.render_view(WRIST), first)
    env.close()


def test_what_is_drawn_afterwards_is_as_usual():
    env, plain = AssemblyEnv("one_leg", shift="light"), AssemblyEnv("one_leg")
    for each in (env, plain):
        each.reset(seed=0)
    before = plain.render_view(FRONT)
    env.render_view(FRONT)
    np.testing.assert_array_equal(plain.render_view(FRONT), before)
    env.close()
    plain.close()


def test_shifts_of_no_size_and_those_of_the_physics_change_no_pixel():
    still = {"kind": "camera", "shift_m": 0.0, "turn_rad": 0.0}
    same = {"kind": "light", "turn_rad": 0.0, "brightness": 1.0}
    for shift in (still, same, "push"):
        for shifted, usual in zip(seen(shift), seen(None), strict=True):
            assert np.abs(shifted - usual).max() <= 1


def test_darker_is_darker():
    dark, usual = (seen({"kind": "light", "turn_rad": 0.0, "brightness": each}, views=(FRONT,))[0] for each in (0.5, 1))
    assert dark.mean() == pytest.approx(0.5 * usual.mean(), rel=0.1)
