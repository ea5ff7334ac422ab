"""Let a policy act: many environments at once, each episode as if it ran alone.

The simulator and the policy meet only here, through the :class:`Policy` protocol.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from juicer.config import canonical_json
from juicer.episode import ACTION_SIZE, ArraySpec, Episode, EpisodeRecord, Outcome, Source
from juicer.errors import ConfigError, InvalidAction, JuicerError, PolicyFailed
from juicer.observer import STATE_OBSERVATIONS, History, Observer
from juicer.progress import EpisodeSteps, Progress, silent_progress
from juicer.seeding import stream
from juicer.shifts import Shift, parse_shift
from juicer.sim.arguments import checked_seed, is_whole, shown
from juicer.sim.controller import real_numbers
from juicer.sim.env import AssemblyEnv
from juicer.sim.recorder import EpisodeRecorder
from juicer.text import printable


class Policy(Protocol):
    """Anything that turns observations into action chunks.

    It may say what it sees in an attribute ``observations``, a sequence of :class:`juicer.episode.ArraySpec`: it is
    shown these and nothing else. Without one it is shown proprioception and part poses,
    :data:`juicer.observer.STATE_OBSERVATIONS`.
    """

    @property
    def obs_horizon(self) -> int:
        """Observations that it is shown (T_o), the last of which is the present one."""
        ...

    @property
    def action_horizon(self) -> int:
        """Actions of a chunk that are executed before the next one is asked for (T_a)."""
        ...

    def predict(
        self, observations: Mapping[str, NDArray[Any]], streams: Sequence[np.random.Generator]
    ) -> NDArray[np.generic]:
        """Action chunks ``(N, at least T_a, 10)``, absolute, for observations ``(N, T_o, ...)``.

        A row must depend on its own observation and its own stream only, never on N or its neighbours.
        """
        ...


Reaction = Callable[[Mapping[str, NDArray[np.float32]]], Any]
"""A plain function from one observation, ``(D,)`` an array, to one action ``(10,)``."""


def as_policy(policy: Policy | Reaction) -> Policy:
    """A policy as it is, or made of a function that depends on nothing but its argument.

    Raises:
        PolicyFailed: If it is neither.
    """
    if isinstance(policy, type):
        raise PolicyFailed(f"a policy is an object, and '{policy.__name__}' is a class; call it to make one")
    if hasattr(policy, "predict"):
        return cast("Policy", policy)
    if not callable(policy):
        raise PolicyFailed(
            "a policy is a function from an observation to an action, or has obs_horizon, action_horizon and predict; "
            f"a {type(policy).__name__} is neither"
        )
    return _Reacting(policy)


class _Reacting:
    obs_horizon = action_horizon = 1

    def __init__(self, react: Reaction) -> None:
        self._react = react

    def predict(
        self, observations: Mapping[str, NDArray[np.float32]], streams: Sequence[np.random.Generator]
    ) -> NDArray[np.generic]:
        seen = [{name: values[row, -1] for name, values in observations.items()} for row in range(len(streams))]
        actions = [real_numbers(self._react(each), "the policy's action") for each in seen]
        for action in actions:
            if action.shape != (ACTION_SIZE,):
                raise InvalidAction(f"the policy returned an action of shape {action.shape}, not ({ACTION_SIZE},)")
        return np.stack(actions)[:, None]


def rollout(
    policy: Policy,
    task: str,
    randomness: str,
    seeds: Iterable[int],
    *,
    num_envs: int,
    max_steps: int | None = None,
    policy_id: str | None = None,
    root_seed: int = 0,
    stop_after_successes: int | None = None,
    num_workers: int | None = None,
    shift: object = None,
    progress: Progress = silent_progress,
) -> Iterator[Episode]:
    """Run one episode for every initial-state seed and yield them in the order of the seeds.

    All running episodes share one policy call a turn, then each executes its own chunk in its own thread. What an
    episode holds depends on the policy, its seed and ``root_seed``, not on ``num_envs``, ``num_workers`` or others.

    Args:
        policy: What acts.
        task: Assembly task, e.g. ``one_leg``.
        randomness: Level of the initial states: ``low``, ``med`` or ``high``.
        seeds: Initial-state seeds; read lazily, so an endless iterator will do with ``stop_after_successes``.
        num_envs: Environments that run side by side.
        max_steps: Steps after which an episode ends as ``timeout``; the task's own limit if None.
        policy_id: Recorded in every episode.
        root_seed: Root of the policy's noise, one stream an episode.
        stop_after_successes: Yield nothing after this many successes in the order of the seeds, whatever ran ahead.
        num_workers: Threads that step environments; as many as there are processors if None.
        shift: In what the scenes differ from training, see :class:`juicer.sim.env.AssemblyEnv`; nothing if None.
        progress: Called every turn; its total is 0 while the number of seeds is not known.

    Raises:
        ConfigError: If ``num_envs`` is not positive, or there is no such shift or the policy cannot notice it.
        InvalidAction: If the policy returns chunks of a wrong shape, or an action the environment refuses.
        PolicyFailed: If the policy raises anything, or has no horizons.
    """
    _check(policy, num_envs)
    observer = _observer(policy, parse_shift(shift))
    total = len(seeds) if isinstance(seeds, Sequence) else 0
    envs = [AssemblyEnv(task, randomness, None, max_steps, shift) for _ in range(min(num_envs, total or num_envs))]
    steps = EpisodeSteps(total, len(envs), envs[0].max_steps if envs else 0, stop_after_successes)
    pool = ThreadPoolExecutor(num_workers or min(len(envs), os.cpu_count() or 1))
    done = successes = 0

    def report() -> None:
        progress(done, total, successes=successes, **steps.facts())

    try:
        for episode in _in_order(_run(policy, observer, envs, seeds, pool, root_seed, policy_id, steps, report)):
            done += 1
            successes += episode.record.outcome is Outcome.SUCCESS
            report()
            yield episode
            if stop_after_successes is not None and successes >= stop_after_successes:
                return
    finally:
        _close(pool, envs)


def _close(pool: ThreadPoolExecutor, envs: Iterable[AssemblyEnv]) -> None:
    pool.shutdown()
    for env in envs:
        env.close()


class _RunningEpisode:
    """An environment, the episode that runs in it, and the episode's own noise."""

    def __init__(
        self, env: AssemblyEnv, observer: Observer, obs_horizon: int, index: int, seed: int, root_seed: int
    ) -> None:
        env.reset(seed=seed)
        self.env = env
        self.index = index
        self.seed = seed
        self.recorder = EpisodeRecorder(env)
        self.history = History(observer, env, obs_horizon)
        self.noise = stream(root_seed, "rollout", seed)

    def __str__(self) -> str:
        return f"step {len(self.recorder)} of the episode from initial state {self.seed}"

    def execute(self, chunk: NDArray[np.generic]) -> None:
        for left, action in zip(reversed(range(len(chunk))), chunk, strict=True):
            try:
                self.recorder.step(action)
            except InvalidAction as error:
                raise InvalidAction(f"at {self} the policy is refused: {error}") from None
            if self.recorder.done:
                return
            if left < self.history.length:
                self.history.look()

    def finish(self, policy_id: str | None) -> Episode:
        info = self.recorder.info
        record = EpisodeRecord(
            source=Source.ROLLOUT,
            task=self.env.task.name,
            randomness=self.env.randomness.value,
            seed=self.seed,
            outcome=Outcome(info["outcome"]),
            parts_assembled=int(info["parts_assembled"]),
            milestones=dict(info["milestones"]),
            policy=policy_id,
            shift=canonical_json(self.env.shift.shift) if self.env.shift else None,
        )
        return self.recorder.episode(record)


def _run(
    policy: Policy,
    observer: Observer,
    envs: Sequence[AssemblyEnv],
    seeds: Iterable[int],
    pool: ThreadPoolExecutor,
    root_seed: int,
    policy_id: str | None,
    steps: EpisodeSteps,
    report: Callable[[], None],
) -> Iterator[tuple[int, Episode]]:
    """Yield episodes with their place among the seeds, as they end; report after every turn."""

    def begin(start: tuple[AssemblyEnv, tuple[int, int]]) -> _RunningEpisode:
        env, (index, seed) = start
        return _RunningEpisode(env, observer, policy.obs_horizon, index, seed, root_seed)

    waiting = enumerate(map(_initial_state, seeds))
    successes = 0
    idle = list(envs)
    running: list[_RunningEpisode] = []
    while True:
        starts = list(zip(idle, waiting, strict=False))
        running += pool.map(begin, starts)
        if not running:
            return
        list(pool.map(_RunningEpisode.execute, running, _predict(policy, observer.names, running)))
        ended = [episode for episode in running if episode.recorder.done]
        for episode in ended:
            succeeded = episode.recorder.info["outcome"] is Outcome.SUCCESS
            successes += succeeded
            steps.end(len(episode.recorder), succeeded=succeeded)
        steps.running = [len(episode.recorder) for episode in running if not episode.recorder.done]
        yield from ((episode.index, episode.finish(policy_id)) for episode in ended)
        if steps.successes is not None and successes >= steps.successes:
            # The last success that counts is among those finished or running: later seeds cannot matter.
            waiting = enumerate(())
        running = [episode for episode in running if not episode.recorder.done]
        report()
        idle = idle[len(starts) :] + [episode.env for episode in ended]


def _initial_state(seed: int) -> int:
    if (number := checked_seed(seed)) is None:
        raise ConfigError("every episode needs an initial-state seed, got None")
    return number


def _check(policy: Policy, num_envs: int) -> None:
    if not is_whole(num_envs) or num_envs < 1:
        raise ConfigError(f"num_envs must be at least 1, got {shown(num_envs)}")
    for name in ("obs_horizon", "action_horizon"):
        horizon = getattr(policy, name, None)
        if not is_whole(horizon) or horizon < 1:
            raise PolicyFailed(f"a policy's {name} must be a whole number of at least 1, got {shown(horizon)}")


def _observer(policy: Policy, shift: Shift | None) -> Observer:
    """Who sees for a policy; it must be able to notice the shift."""
    observer = Observer(_declared(policy))
    if shift and not shift.can_be_noticed(sees_images=observer.sees_images):
        raise ConfigError(
            f"the policy sees no images, so it cannot notice a shift of kind '{shift.kind}', which changes nothing "
            "else; evaluate it without that shift"
        )
    return observer


def _declared(policy: Policy) -> Sequence[ArraySpec]:
    """What a policy says that it sees."""
    specs = getattr(policy, "observations", STATE_OBSERVATIONS)
    if not isinstance(specs, Sequence) or not specs or not all(isinstance(spec, ArraySpec) for spec in specs):
        raise PolicyFailed(f"a policy's observations must be a list of ArraySpec, got {shown(specs)}")
    return specs


def _predict(policy: Policy, names: Sequence[str], running: Sequence[_RunningEpisode]) -> NDArray[np.generic]:
    """One chunk of ``action_horizon`` actions for every running episode: ``(N, T_a, 10)``."""
    observations = {name: np.stack([episode.history.array(name) for episode in running]) for name in names}
    try:
        answer = policy.predict(observations, [episode.noise for episode in running])
        chunks = real_numbers(answer, "the policy's action chunks")
    except InvalidAction as error:
        raise _refused(running, error) from None
    except JuicerError:
        raise
    except Exception as error:  # whatever a stranger's policy may raise
        rows = f"{len(running)} episode{'s' * (len(running) > 1)}"
        reason = f"{type(error).__name__}: {printable(error)}"
        raise PolicyFailed(f"the policy failed on {rows}, at {running[0]}: {reason}") from error
    horizon = policy.action_horizon
    if chunks.ndim != 3 or len(chunks) != len(running) or chunks.shape[1] < horizon or chunks.shape[2] != ACTION_SIZE:
        expected = f"({len(running)}, at least {horizon}, {ACTION_SIZE})"
        raise _refused(running, f"the policy returned action chunks of shape {chunks.shape}, but {expected} is needed")
    return chunks[:, :horizon]


def _refused(running: Sequence[_RunningEpisode], reason: object) -> InvalidAction:
    return InvalidAction(f"at {running[0]}: {reason}")


def _in_order(indexed: Iterator[tuple[int, Episode]]) -> Iterator[Episode]:
    """Hold episodes back until all before them are out."""
    held: dict[int, Episode] = {}
    due = 0
    for index, episode in indexed:
        held[index] = episode
        while due in held:
            yield held.pop(due)
            due += 1
