"""Let the scripted operator work, and record it as a human's recording tool would."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from juicer.demonstration.log import SUFFIX, OperatorLog, write_log
from juicer.episode import EpisodeRecord, Outcome, Source
from juicer.expert.operator import DEVICE, ScriptedOperator
from juicer.progress import Progress, silent_progress
from juicer.seeding import stream
from juicer.sim.env import STEP_S, AssemblyEnv
from juicer.sim.recorder import EpisodeRecorder


def record_demonstration(env: AssemblyEnv, operator: ScriptedOperator, seed: int) -> OperatorLog:
    """Reset the environment to ``seed`` and let the operator work until the episode ends.

    Timestamps count simulated time, so that the same operator on the same seed gives the same log.
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
        device=DEVICE,
    )
    timestamp_s = np.arange(len(idle), dtype=np.float64) * STEP_S
    return OperatorLog.of(recorder.episode(record), timestamp_s, np.array(idle))


def recordings(
    task: str, randomness: str, seeds: Iterable[int], *, root_seed: int = 0, workers: int = 1
) -> Generator[OperatorLog]:
    """Recordings of the scripted operator, one a seed and in their order, made in parallel threads.

    A recording depends on the seed and ``root_seed`` alone.

    Args:
        task: Assembly task, e.g. ``one_leg``.
        randomness: Level of the initial states.
        seeds: Initial-state seeds, read lazily.
        root_seed: Root of the operator's habits.
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
            operator = ScriptedOperator(env.task, stream(root_seed, "operator", seed))
            return record_demonstration(env, operator, seed)
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
    *,
    successes: int,
    root_seed: int = 0,
    workers: int = 1,
    progress: Progress = silent_progress,
) -> int:
    """Write operator logs into a folder until enough of them are successes; failures are kept too, and marked.

    Args:
        folder: Where the logs go, named by their seeds.
        task: Assembly task.
        randomness: Level of the initial states.
        seeds: Initial-state seeds at the operator's disposal.
        successes: Successful demonstrations wanted.
        root_seed: Root of the operator's habits.
        workers: Environments that run side by side.
        progress: Told of every success.

    Returns:
        The number of successes, fewer than wanted if the seeds did not suffice.

    Raises:
        ConfigError: If the task is unknown, or the operator has not learned it.
    """
    achieved = 0
    logs = recordings(task, randomness, seeds, root_seed=root_seed, workers=workers)
    for made, log in enumerate(logs, start=1):
        write_log(folder / f"{log.seed:08d}{SUFFIX}", log)
        achieved += log.success
        progress(achieved, successes, recordings=made, steps=len(log))
        if achieved >= successes:
            logs.close()
            break
    return achieved
