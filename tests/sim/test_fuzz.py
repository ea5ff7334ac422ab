"""Whatever is called in whatever order: an environment answers, or refuses in a sentence; it never breaks."""

from __future__ import annotations

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from juicer.errors import InvalidAction, InvalidEpisode
from juicer.sim.env import AssemblyEnv

ENV = AssemblyEnv("lamp", max_steps=20)
ACTION = st.lists(st.floats(width=32, min_value=-1, max_value=1), min_size=10, max_size=10)
WILD_ACTION = st.lists(st.floats(width=32), min_size=9, max_size=11)
EDIT = st.tuples(st.integers(0, len(ENV.get_state()) - 1), st.floats() | st.integers(-12, 6).map(float))
CALL = st.one_of(
    st.tuples(st.just("reset"), st.integers(0, 2**40)),
    st.tuples(st.just("step"), ACTION | WILD_ACTION),
    st.tuples(st.just("edit the state"), st.lists(EDIT, max_size=3)),
    st.tuples(st.just("copy"), st.none()),
)


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(CALL, min_size=1, max_size=12))
def test_no_sequence_of_calls_breaks_an_environment(calls):
    env = ENV
    env.reset(seed=0)
    for name, argument in calls:
        before = env.get_state()
        try:
            if name == "reset":
                env.reset(seed=argument)
            elif name == "step":
                env.step(np.array(argument))
            elif name == "copy":
                env = env.__copy__()
            else:
                state = env.get_state()
                for index, value in argument:
                    state[index] = value
                env.set_state(state)
        except (InvalidAction, InvalidEpisode):
            np.testing.assert_array_equal(env.get_state(), before)
        assert len(env.get_state()) == len(before)
        assert set(env.observation()) == {"proprioception", "part_poses"}
    env.reset(seed=1)
    fresh = AssemblyEnv("lamp")
    fresh.reset(seed=1)
    np.testing.assert_array_equal(env.get_state(), fresh.get_state())
