"""The lamp's hood, which is put on and not screwed: what counts as assembled, and what does not."""

from __future__ import annotations

import numpy as np
import pytest

from juicer.geometry import quat_multiply, quat_to_matrix
from juicer.sim.env import AssemblyEnv
from juicer.sim.scene import home_xy
from juicer.tasks.furniture_bench import PITCH

BASE, BULB, HOOD = 0, 1, 2


class Lamp:
    """A lamp whose base stands in the corner, bulb and hood over it; the robot stays away."""

    def __init__(self, bulb_above_m: float, hood_above_m: float) -> None:
        """Place the parts so far above their seats; a bulb in its thread stays there, the hood falls."""
        self.env = env = AssemblyEnv("lamp")
        env.reset(seed=0)
        self.poses = env._views.part_poses.reshape(-1, 7)
        base = env.task.parts[BASE]
        corner = [home - 2e-4 for home in home_xy(base)]
        self.poses[BASE] = [*corner, base.start[2] + 1e-4, *base.start[3:]]
        for pair, above in zip(env.task.pairs, (bulb_above_m, hood_above_m), strict=True):
            target = np.array(pair.targets[0])
            seat = self.poses[BASE, :3] + quat_to_matrix(self.poses[BASE, 3:]) @ target[:3]
            self.poses[pair.second] = [*seat, *quat_multiply(self.poses[BASE, 3:], target[3:])]
            self.poses[pair.second, 2] += above
        env.data.qvel[:] = 0
        env.data.tree_asleep[:] = -11
        env.set_state(env.get_state())

    def wait(self, steps: int) -> dict[str, object]:
        """Let the robot stand still; returns what the environment says at the end."""
        action = np.append(self.env.observation()["proprioception"][:9], -1.0).astype(np.float32)
        for _ in range(steps):
            *_, info = self.env.step(action)
        return info

    def nudge(self, velocity_m_s: float) -> None:
        """Set the base in motion along the table, with what stands on it."""
        for part in self.env.task.parts:
            start = self.env.model.joint(part.name).dofadr[0]
            self.env.data.qvel[start : start + 2] = velocity_m_s
        self.env.data.tree_asleep[:] = -11


def test_a_hood_that_is_let_fall_over_the_bulb_comes_to_its_seat():
    assert Lamp(bulb_above_m=0.0, hood_above_m=0.025).wait(2)["outcome"] == "success"


def test_a_hood_does_not_count_while_the_bulb_is_not_screwed_home():
    lamp = Lamp(bulb_above_m=PITCH, hood_above_m=0.0)
    info = lamp.wait(5)
    assert (info["parts_assembled"], info["outcome"]) == (0, None)


def test_a_bulb_that_stands_too_high_holds_the_hood_up():
    high, home = Lamp(bulb_above_m=PITCH, hood_above_m=0.025), Lamp(bulb_above_m=0.0, hood_above_m=0.025)
    high.wait(2)
    assert ("lamp_bulb", "lamp_hood") in high.env.contact_pairs()
    assert high.wait(3)["parts_assembled"] == 0
    home.wait(5)
    assert high.poses[HOOD, 2] > home.poses[HOOD, 2] + 0.002


def test_a_hood_without_anything_under_it_is_no_lamp():
    lamp = Lamp(bulb_above_m=0.0, hood_above_m=0.0)
    lamp.poses[BULB, :3] = [0.45, -0.1, 0.1]
    lamp.env.set_state(lamp.env.get_state())
    assert lamp.wait(10)["parts_assembled"] == 0


@pytest.mark.parametrize("velocity_m_s", [0.15, -0.15])
def test_an_assembled_lamp_stays_so_when_it_is_nudged(velocity_m_s):
    lamp = Lamp(bulb_above_m=0.0, hood_above_m=0.001)
    lamp.wait(5)
    lamp.nudge(velocity_m_s)
    lamp.wait(15)
    for pair, progress in zip(lamp.env.task.pairs, lamp.env._pairs, strict=True):
        assembled = progress.measure(lamp.env._views.part_positions, lamp.env._views.part_matrices)[-1]
        assert assembled, f"{pair.label} came off"
