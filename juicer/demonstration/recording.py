"""Let an operator work, and record it: every step from the reset to the end of the episode, idle ones too."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from juicer.demonstration.log import SUFFIX, OperatorLog, write_log
from juicer.demonstration.operator import Operator, OperatorFactory
from juicer.episode import EpisodeRecord, Outcome, Source
from juicer.progress import Progress, silent_progress
from juicer.sim.env import STEP_S, AssemblyEnv
from juicer.sim.recorder import EpisodeRecorder


@dataclass(frozen=True)
class Sitting:
    """What recording demonstrations came to.

    Attributes:
        recordings: Logs that were written.
        successes: Those of them in which everything was assembled.
        steps: Steps of all of them, those of failures and idle ones included.
        idle_steps: Steps in which the operator was idle.
    """

    recordings: int = 0
    successes: int = 0
    steps: int = 0
    idle_steps: int = 0

    def with_log(self, log: OperatorLog) -> Sitting:
        """With another recording."""
        idle = int(np.count_nonzero(log.idle))
        return Sitting(self.recordings + 1, self.successes + log.success, self.steps + len(log), self.idle_steps + idle)


def minutes_of(steps: int) -> float:
    """How long so many steps are, one every 0.1 s; whoever pauses, undoes or drives slowly sits there longer."""
    return round(steps * STEP_S / 60, 2)


def record_demonstration(
    env: AssemblyEnv, operator: Operator, seed: int, *, name: str | None = None, recorded_at: str | None = None
) -> OperatorLog:
    """Reset the environment to ``seed`` and let the operator work until the episode ends.

    Timestamps count simulated time, so that the same operator on the same seed gives the same log.

    Args:
        env: Where the operator works.
        operator: Who works.
        seed: Initial-state seed.
        name: Who the operator is, if the log is to say it.
        recorded_at: When this is, e.g. ``2026-11-26T14:03:00+01:00``, if the log is to say it.

    Raises:
        InvalidAction: If the environment refuses an action.
    """
    env.reset(seed=seed)
    recorder = EpisodeRecorder(env)
    idle: list[bool] = []
    while not recorder.done:
        step = operator.act(recorder.observation)
        recorder.step(step.action)
        idle.append(step.idle)
    record = EpisodeRecord(
        source=Source.TELEOP,
        task=env.task.name,
        randomness=str(env.randomness),
        seed=seed,
        outcome=Outcome(recorder.info["outcome"]),
        parts_assembled=recorder.info["parts_assembled"],
        milestones=recorder.info["milestones"],
        device=operator.device,
        operator=name,
        recorded_at=recorded_at,
    )
    timestamp_s = np.arange(len(idle), dtype=np.float64) * STEP_S
    return OperatorLog.of(recorder.episode(record), timestamp_s, np.array(idle))


def recordings(
    task: str, randomness: str, seeds: Iterable[int], operator_of: OperatorFactory, *, workers: int = 1
) -> Generator[OperatorLog]:
    """Recordings of operators, one a seed and in their order, made in parallel threads.

    Args:
        task: Assembly task, e.g. ``one_leg``.
        randomness: Level of the initial states.
        seeds: Initial-state seeds, read lazily.
        operator_of: Makes the operator of a recording, on which alone it depends besides the seed.
        workers: Environments that run side by side.

    Raises:
        ConfigError: If the task is unknown, or the operator has not learned it.
    """
    envs: SimpleQueue[AssemblyEnv] = SimpleQueue()
    for _ in range(workers):
        envs.put(AssemblyEnv(task, randomness))

    def make(seed: int) -> OperatorLog:
        env = envs.get()
        try:
            return record_demonstration(env, operator_of(env.task, seed), seed)
        finally:
            envs.put(env)

    waiting = iter(seeds)
    with ThreadPoolExecutor(workers) as pool:
        ahead: deque[Future[OperatorLog]] = deque(pool.submit(make, seed) for seed in islice(waiting, workers))
        try:
            while ahead:
                log = ahead.popleft().result()
                ahead.extend(pool.submit(make, seed) for seed in islice(waiting, 1))
                yield log
        finally:
            for future in ahead:
                future.cancel()


def record_demonstrations(
    folder: Path,
    task: str,
    randomness: str,
    seeds: Sequence[int],
    operator_of: OperatorFactory,
    *,
    successes: int,
    workers: int = 1,
    progress: Progress = silent_progress,
) -> Sitting:
    """Write operator logs into a folder until enough of them are successes; failures are kept too, and marked.

    Args:
        folder: Where the logs go, named by their seeds.
        task: Assembly task.
        randomness: Level of the initial states.
        seeds: Initial-state seeds at the operators' disposal.
        operator_of: Makes the operator of a recording.
        successes: Successful demonstrations wanted.
        workers: Environments that run side by side.
        progress: Called for every success.

    Returns:
        What it came to, with fewer successes than wanted if the seeds did not suffice.

    Raises:
        ConfigError: If the task is unknown, or the operator has not learned it.
    """
    sitting = Sitting()
    logs = recordings(task, randomness, seeds, operator_of, workers=workers)
    for log in logs:
        write_log(folder / f"{log.seed:08d}{SUFFIX}", log)
        sitting = sitting.with_log(log)
        progress(sitting.successes, successes, recordings=sitting.recordings, steps=len(log))
        if sitting.successes >= successes:
            logs.close()
            break
    return sitting
