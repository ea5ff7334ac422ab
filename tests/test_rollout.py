from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from juicer.episode import STATE_KEY, Episode, Outcome, Source
from juicer.errors import ConfigError, InvalidAction, PolicyFailed
from juicer.rollout import as_policy, rollout
from juicer.sim.env import AssemblyEnv


class Wanderer:
    """Moves about where it is, with noise from each episode's own stream."""

    obs_horizon, action_horizon = 1, 3

    def __init__(self) -> None:
        self.rows: list[int] = []

    def predict(
        self, observations: Mapping[str, NDArray[np.float32]], streams: Sequence[np.random.Generator]
    ) -> NDArray[np.float64]:
        proprioception = observations["proprioception"][:, -1]
        self.rows.append(len(proprioception))
        chunks = np.repeat(np.append(proprioception[:, :9], np.ones((len(streams), 1)), axis=1)[:, None], 4, axis=1)
        for chunk, noise in zip(chunks, streams, strict=True):
            chunk[:, :3] += noise.normal(0, 0.01, (4, 3))
        return chunks


class ScriptedEnv(AssemblyEnv):
    """Ends after ``3 + seed`` steps: odd seeds succeed, the others lose a part."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self.seed, self.taken = seed or 0, 0
        return super().reset(seed=seed)

    def step(self, action: NDArray[np.floating[Any]]) -> Any:
        observation, reward, *_, info = super().step(action)
        self.taken += 1
        if self.taken < 3 + self.seed:
            return observation, reward, False, False, info
        info["outcome"] = Outcome.SUCCESS if self.seed % 2 else Outcome.PART_LOST
        return observation, reward, True, False, info


class ExplodingEnv(AssemblyEnv):
    """Episodes of even seeds fly apart in their third step."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self.fuse = 2 if seed is not None and seed % 2 == 0 else -1
        return super().reset(seed=seed)

    def step(self, action: NDArray[np.floating[Any]]) -> Any:
        if self.fuse == 0:
            self.data.qvel[-1] = 1e9
        self.fuse -= 1
        return super().step(action)


def run(seeds: Sequence[int], **settings: Any) -> list[Episode]:
    settings = {"num_envs": 2, "max_steps": 8} | settings
    return list(rollout(Wanderer(), "one_leg", "low", seeds, **settings))


def assert_identical(first: Episode, second: Episode) -> None:
    assert first.record == second.record
    for name in first.steps:
        np.testing.assert_array_equal(first.steps[name], second.steps[name], err_msg=name)
    for name in first.final:
        np.testing.assert_array_equal(first.final[name], second.final[name], err_msg=name)


def test_episodes_come_in_the_order_of_the_seeds_and_say_who_acted():
    episodes = run([7, 3, 5], policy_id="0123")
    assert [episode.record.seed for episode in episodes] == [7, 3, 5]
    assert {episode.record.policy for episode in episodes} == {"0123"}
    assert all(episode.record.source is Source.ROLLOUT for episode in episodes)
    assert all(episode.record.outcome is Outcome.TIMEOUT and len(episode) == 8 for episode in episodes)


@pytest.mark.parametrize(("num_envs", "num_workers"), [(1, 1), (3, 2), (5, 1)])
def test_an_episode_does_not_depend_on_what_runs_beside_it(num_envs: int, num_workers: int):
    alone = run([4], num_envs=1)[0]
    beside = run([1, 4, 2, 3], num_envs=num_envs, num_workers=num_workers)[1]
    assert_identical(alone, beside)


def test_a_reused_environment_leaves_no_trace(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("juicer.rollout.AssemblyEnv", ScriptedEnv)
    for first, second in zip(run([6, 1, 4, 2], num_envs=1), run([6, 1, 4, 2], num_envs=3), strict=True):
        assert_identical(first, second)


def test_the_root_seed_decides_the_noise():
    first, second = run([4], root_seed=0)[0], run([4], root_seed=1)[0]
    np.testing.assert_array_equal(first.steps[STATE_KEY][0], second.steps[STATE_KEY][0])
    assert not np.array_equal(first.steps["action"], second.steps["action"])


def test_every_recorded_state_replays_to_the_end_of_the_episode():
    episode = run([2])[0]
    env = AssemblyEnv("one_leg")
    env.set_state(episode.steps[STATE_KEY][3])
    for action in episode.steps["action"][3:]:
        env.step(action)
    np.testing.assert_array_equal(env.get_state(), episode.final[STATE_KEY])


def test_each_step_holds_what_was_seen_before_its_action():
    episode = run([2])[0]
    env = AssemblyEnv("one_leg")
    for step in (0, 4):
        env.set_state(episode.steps[STATE_KEY][step])
        np.testing.assert_array_equal(env.observation()["proprioception"], episode.steps["proprioception"][step])


def test_episodes_of_every_outcome_are_kept(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("juicer.rollout.AssemblyEnv", ScriptedEnv)
    episodes = run([0, 1, 2])
    assert [episode.record.outcome for episode in episodes] == [Outcome.PART_LOST, Outcome.SUCCESS, Outcome.PART_LOST]
    assert [len(episode) for episode in episodes] == [3, 4, 5]


def test_an_explosion_is_an_outcome_and_harms_no_later_episode(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    alone = run([3])[0]
    monkeypatch.setattr("juicer.rollout.AssemblyEnv", ExplodingEnv)
    exploded, after = run([2, 3], num_envs=1)
    assert exploded.record.outcome is Outcome.DIVERGED
    assert len(exploded) == 3
    assert_identical(alone, after)
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("num_envs", [1, 3, 6])
def test_collection_stops_at_the_same_seed_however_many_run_ahead(num_envs: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("juicer.rollout.AssemblyEnv", ScriptedEnv)
    seeds = [8, 3, 6, 1, 2, 5, 7]
    episodes = run(seeds, num_envs=num_envs, stop_after_successes=2)
    assert [episode.record.seed for episode in episodes] == [8, 3, 6, 1]


def test_no_episode_is_begun_that_cannot_matter(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("juicer.rollout.AssemblyEnv", ScriptedEnv)
    policy = Wanderer()
    list(rollout(policy, "one_leg", "low", [8, 1, 2, 3, 4, 5, 6], num_envs=2, stop_after_successes=1))
    assert policy.rows == [2, 2, 1, 1]


def test_progress_hears_of_every_episode():
    heard: list[tuple[int, int]] = []
    run([1, 2, 3], progress=lambda done, total, **_: heard.append((done, total)))
    assert list(dict.fromkeys(heard)) == [(0, 3), (1, 3), (2, 3), (3, 3)]


def test_progress_hears_of_every_step_and_of_those_to_come():
    heard: list[tuple[int, int]] = []
    run([1, 2, 3], progress=lambda done, total, **facts: heard.append((facts["steps"], facts["expected_steps"])))
    steps = [step for step, _ in heard]
    assert steps == sorted(steps)
    assert heard[-1] == (24, 24)


def test_no_seeds_give_no_episodes():
    assert run([]) == []


def test_a_policy_whose_chunks_are_too_short_is_refused():
    class Hasty(Wanderer):
        action_horizon = 5

    with pytest.raises(InvalidAction, match=r"at least 5, 10"):
        list(rollout(Hasty(), "one_leg", "low", [1], num_envs=1))


def test_a_policy_sees_as_many_observations_as_it_wants_the_first_repeated_before_it():
    class Historian(Wanderer):
        obs_horizon = 5

        def __init__(self) -> None:
            super().__init__()
            self.seen: list[NDArray[np.float32]] = []

        def predict(
            self, observations: Mapping[str, NDArray[np.float32]], streams: Sequence[np.random.Generator]
        ) -> NDArray[np.float64]:
            self.seen.append(observations["part_poses"][0])
            return super().predict(observations, streams)

    policy = Historian()
    (episode,) = rollout(policy, "one_leg", "low", [1], num_envs=1, max_steps=8)
    shown = episode.steps["part_poses"]
    for turn, history in zip((0, 3, 6), policy.seen, strict=True):
        np.testing.assert_array_equal(history, shown[np.clip(np.arange(turn - 4, turn + 1), 0, None)])


def test_rollout_needs_an_environment():
    with pytest.raises(ConfigError, match="num_envs must be at least 1, got 0"):
        run([1], num_envs=0)


@pytest.mark.parametrize(
    ("answer", "problem"),
    [
        (lambda count: np.full((count, 4, 10), np.nan), "at step 0 of the episode from initial state 7 .* finite"),
        (lambda count: np.full((count, 4, 10), 3.0), "at step 0 .* within"),
        (lambda count: np.zeros((count, 4, 10)), "at step 0 .* degenerate"),
        (lambda count: np.zeros((count, 4, 9)), r"shape \(1, 4, 9\), but \(1, at least 3, 10\) is needed"),
        (lambda count: np.zeros((count, 10)), r"shape \(1, 10\)"),
        (lambda count: np.zeros((count + 1, 4, 10)), r"shape \(2, 4, 10\)"),
        (lambda count: np.zeros((count, 4, 10), dtype=complex), "action chunks must be an array of real numbers"),
        (lambda count: np.full((count, 4, 10), "0.1"), "action chunks must be an array of real numbers"),
        (lambda count: [[1], [2, 3]], "action chunks cannot be read as an array"),
        (lambda count: torch.zeros((count, 4, 10), requires_grad=True), "action chunks cannot be read .* grad"),
        (lambda count: None, "action chunks must be an array of real numbers"),
    ],
)
def test_what_a_policy_returns_wrongly_is_named(answer: Any, problem: str):
    class Wrong(Wanderer):
        def predict(self, observations: Any, streams: Any) -> Any:
            return answer(len(streams))

    with pytest.raises(InvalidAction, match=problem):
        list(rollout(Wrong(), "one_leg", "low", [7], num_envs=1))


def test_an_action_that_is_refused_later_says_at_which_step():
    class Tiring(Wanderer):
        def predict(self, observations: Any, streams: Any) -> Any:
            chunks = super().predict(observations, streams)
            chunks[:, 2] = np.inf if len(self.rows) > 1 else chunks[:, 2]
            return chunks

    with pytest.raises(InvalidAction, match="at step 5 of the episode from initial state 7 the policy is refused"):
        list(rollout(Tiring(), "one_leg", "low", [7], num_envs=1))


def test_whatever_a_policy_raises_is_told_with_its_cause():
    class Broken(Wanderer):
        def predict(self, observations: Any, streams: Any) -> Any:
            return observations["images"]

    with pytest.raises(PolicyFailed, match=r"failed on 2 episodes, at step 0 .* state 1: KeyError: 'images'") as caught:
        list(rollout(Broken(), "one_leg", "low", [1, 2, 3], num_envs=2))
    assert isinstance(caught.value.__cause__, KeyError)


@pytest.mark.parametrize("horizon", [0, -1, 1.0, True, None, "8"])
def test_a_policy_needs_horizons(horizon: Any):
    class Aimless(Wanderer):
        action_horizon = horizon

    with pytest.raises(PolicyFailed, match="action_horizon must be a whole number of at least 1"):
        list(rollout(Aimless(), "one_leg", "low", [1], num_envs=1))


def test_numpys_numbers_are_initial_states_and_fractions_are_not():
    plain, numpys = run([4])[0], run(np.array([4]))[0]
    assert_identical(plain, numpys)
    assert type(numpys.record.seed) is int
    for wrong in (1.5, None, True):
        with pytest.raises(ConfigError, match="seed"):
            run([wrong])


def stay(observation: Mapping[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    return np.append(observation["proprioception"][:9], np.float32(1))


def test_a_plain_function_is_a_policy():
    episodes = list(rollout(as_policy(stay), "one_leg", "low", [1, 2], num_envs=2, max_steps=4))
    assert [len(episode) for episode in episodes] == [4, 4]
    np.testing.assert_array_equal(episodes[1].steps["action"][2, :9], episodes[1].steps["proprioception"][2, :9])
    wanderer = Wanderer()
    assert as_policy(wanderer) is wanderer


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [(Wanderer, "'Wanderer' is a class; call it"), (3, "a int is neither"), ("bc", "a str is neither")],
)
def test_what_is_no_policy_is_told_apart(wrong: Any, problem: str):
    with pytest.raises(PolicyFailed, match=problem):
        as_policy(wrong)


def test_a_function_must_give_one_action():
    with pytest.raises(InvalidAction, match=r"an action of shape \(9,\), not \(10,\)"):
        list(rollout(as_policy(lambda seen: stay(seen)[:9]), "one_leg", "low", [1], num_envs=1))
