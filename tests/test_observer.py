"""A policy sees what it declares and nothing else, also images, however many episodes run side by side."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.episode import SIMULATOR, STATE_KEY, ArraySpec, Role
from juicer.errors import PolicyFailed
from juicer.observer import History, Observer, image
from juicer.rollout import rollout
from juicer.sim.env import AssemblyEnv
from juicer.views import View

ACTION = np.array([0.5, 0.15, 0.1, 0, 1, 0, 1, 0, 0, 1], dtype=np.float32)


class Looker:
    """Remembers what it was shown, and moves by how bright the image of the wrist is."""

    observations = (SIMULATOR["proprioception"], image("wrist", 32, 24))
    obs_horizon, action_horizon = 2, 3

    def __init__(self) -> None:
        self.shown: list[Mapping[str, NDArray[Any]]] = []

    def predict(
        self, observations: Mapping[str, NDArray[Any]], streams: Sequence[np.random.Generator]
    ) -> NDArray[np.float64]:
        self.shown.append(observations)
        here = observations["proprioception"][:, -1, :9].astype(np.float64)
        here[:, 2] += 0.02 * observations["wrist"][:, -1].mean(axis=(1, 2, 3)) / 255
        return np.append(here, np.ones((len(streams), 1)), axis=1)[:, None].repeat(3, axis=1)


@pytest.fixture
def env():
    env = AssemblyEnv()
    env.reset(seed=0)
    yield env
    env.close()


@pytest.mark.usefixtures("drawing")
def test_a_policy_of_images_acts_the_same_in_eight_environments_as_in_one():
    policy = Looker()
    seeds = list(range(8))
    together = list(rollout(policy, "one_leg", "low", seeds, num_envs=8, num_workers=8, max_steps=7))
    first = policy.shown[0]
    assert first["wrist"].shape == (8, 2, 24, 32, 3)
    assert first["wrist"].dtype == np.uint8
    assert first["wrist"].std() > 10
    assert set(first) == {"proprioception", "wrist"}
    alone = [next(rollout(Looker(), "one_leg", "low", [seed], num_envs=1, max_steps=7)) for seed in seeds]
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_array_equal(one.steps[STATE_KEY], other.steps[STATE_KEY])
    assert set(together[0].steps) == set(SIMULATOR.names())
    assert "renderer" not in {thread.name for thread in threading.enumerate()}


def test_only_what_is_looked_at_is_made(env: AssemblyEnv, monkeypatch: pytest.MonkeyPatch):
    drawn: list[int] = []

    class Blinking(Looker):
        action_horizon = 3

        def predict(self, observations: Any, streams: Any) -> Any:
            super().predict(observations, streams)
            return np.tile(ACTION, (len(streams), 3, 1))

    def render(self: AssemblyEnv, view: View) -> NDArray[np.uint8]:
        drawn.append(1)
        return np.zeros((view.height, view.width, 3), np.uint8)

    monkeypatch.setattr(AssemblyEnv, "render_view", render)
    list(rollout(Blinking(), "one_leg", "low", [0], num_envs=1, max_steps=6))
    # Of two observations, the last two of each chunk of three steps; of the last chunk, those before its end.
    assert len(drawn) == 1 + 2 + 1


def test_the_past_in_front_of_the_first_step_is_the_first_step(env: AssemblyEnv):
    history = History(Observer([SIMULATOR["proprioception"]]), env, 3)
    start = env.observation()["proprioception"]
    np.testing.assert_array_equal(history.array("proprioception"), [start] * 3)
    env.step(ACTION)
    history.look()
    np.testing.assert_array_equal(history.array("proprioception"), [start, start, env.observation()["proprioception"]])


@pytest.mark.parametrize(
    "spec",
    [
        ArraySpec("side", (24, 32, 3), "uint8", Role.OBSERVATION),
        ArraySpec("front", (24, 32), "uint8", Role.OBSERVATION),
        ArraySpec("front", (24, None, 3), "uint8", Role.OBSERVATION),
        ArraySpec("front", (24, 32, 3), "float32", Role.OBSERVATION),
        SIMULATOR[STATE_KEY],
    ],
)
def test_what_cannot_be_seen_is_refused_before_the_first_episode(spec: ArraySpec):
    with pytest.raises(PolicyFailed, match=r"the policy asks to see .* there are proprioception, part_poses, fr"):
        Observer([spec])


@pytest.mark.parametrize("wrong", ["proprioception", [], ["proprioception"], None, 3])
def test_observations_that_are_no_specifications_are_refused(wrong: Any):
    policy = Looker()
    policy.observations = wrong
    with pytest.raises(PolicyFailed, match="observations must be a list of ArraySpec"):
        list(rollout(policy, "one_leg", "low", [0], num_envs=1))
