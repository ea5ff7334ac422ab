"""How often the scripted operator assembles, how long it takes and how much of that it stands still, where it fails.

python -m benchmarks.operator_success [--task one_leg] [--randomness low] [--episodes 100] [--seed-start 5000]
    [--temperament '{"kind": "human", "reaction_steps": 1}']
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from statistics import fmean

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from juicer.demonstration.log import OperatorLog
from juicer.demonstration.recording import recordings
from juicer.evaluation import wilson_interval
from juicer.expert.operator import scripted_operators
from juicer.expert.temperament import Temperament
from juicer.gripper import gripper_commands
from juicer.tasks.registry import get_task

STILL_M_S, STILL_RAD_S = 0.01, 0.1


def main() -> None:
    """Record and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="one_leg")
    parser.add_argument("--randomness", default="low", choices=("low", "med", "high"))
    parser.add_argument("--temperament", default='{"kind": "steady"}', help="as in record.temperament, but as JSON")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed-start", type=int, default=5000)
    parser.add_argument("--root-seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    seeds = range(options.seed_start, options.seed_start + options.episodes)
    begin = time.perf_counter()
    logs: list[OperatorLog] = []
    temperament: Temperament = TypeAdapter(Temperament).validate_json(options.temperament)
    operators = scripted_operators(options.root_seed, temperament)
    for log in recordings(options.task, options.randomness, seeds, operators, workers=options.workers):
        logs.append(log)
        if not log.success:
            print(f"seed {log.seed}: {log.outcome} after {len(log)} steps, reached {dict(log.milestones)}", flush=True)
    print_table(options.task, options.randomness, logs, time.perf_counter() - begin)


def is_still(log: OperatorLog) -> NDArray[np.bool_]:
    """At which of the steps that are not idle the end effector hardly moves ``(T,)``."""
    velocity = np.asarray(log.steps["proprioception"][~log.idle, 9:15])
    speed, spin = np.linalg.norm(velocity[:, :3], axis=1), np.linalg.norm(velocity[:, 3:], axis=1)
    return np.asarray((speed < STILL_M_S) & (spin < STILL_RAD_S))


def waits_before_grasps(log: OperatorLog) -> list[int]:
    """For each command to close the gripper: how many steps in a row, up to its own, the end effector stood still."""
    still = is_still(log)
    closes = np.flatnonzero(np.diff(gripper_commands(log.steps["action"][~log.idle]), prepend=-1.0) > 0)
    moving = np.flatnonzero(~still)
    return [int(step - max(moving[moving <= step], default=-1)) for step in closes]


def print_table(task: str, randomness: str, logs: list[OperatorLog], seconds: float) -> None:
    """Success rate with its interval, lengths, the funnel of milestones, and speed."""
    successes = [log for log in logs if log.success]
    low, high = wilson_interval(len(successes), len(logs))
    rate = len(successes) / len(logs)
    print(f"\n{task}, {randomness} randomness, {len(logs)} episodes")
    print(f"  success         {rate:6.1%}  ({len(successes)}, 95 % interval {low:.1%} to {high:.1%})")
    if successes:
        lengths = [len(log) for log in successes]
        idle = fmean(float(log.idle.mean()) for log in successes)
        still = fmean(float(is_still(log).mean()) for log in successes)
        waits = [steps for log in successes for steps in waits_before_grasps(log)]
        print(f"  steps           {fmean(lengths):6.0f}  ({min(lengths)} to {max(lengths)}, {idle:.1%} of them idle)")
        print(f"  standing still  {still:6.1%}  (of the steps that are not idle)")
        long = fmean(steps > 2 for steps in waits)
        print(
            f"  before a grasp  {fmean(waits):6.1f}  (steps of standing still; more than two in {long:.0%} of grasps)"
        )
    reached = Counter(name for log in logs for name in log.milestones)
    for name in get_task(task).milestones:
        steps = [log.milestones[name] for log in logs if name in log.milestones]
        print(f"  {name:<16}{reached[name] / len(logs):6.1%}" + (f"  (step {fmean(steps):.0f})" if steps else ""))
    total = sum(len(log) for log in logs)
    print(f"  wall time       {seconds:6.1f} s  ({total / seconds:.0f} steps/s)")


if __name__ == "__main__":
    main()
