"""How often the scripted operator assembles, how long it takes, and where it fails.

python -m benchmarks.operator_success [--task one_leg] [--randomness low] [--episodes 100] [--seed-start 5000]
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from statistics import fmean

from juicer.demonstration.log import OperatorLog
from juicer.demonstration.recording import recordings
from juicer.evaluation import wilson_interval
from juicer.expert.operator import scripted_operators
from juicer.tasks.registry import get_task


def main() -> None:
    """Record and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="one_leg")
    parser.add_argument("--randomness", default="low", choices=("low", "med", "high"))
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed-start", type=int, default=5000)
    parser.add_argument("--root-seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    seeds = range(options.seed_start, options.seed_start + options.episodes)
    begin = time.perf_counter()
    logs: list[OperatorLog] = []
    operators = scripted_operators(options.root_seed)
    for log in recordings(options.task, options.randomness, seeds, operators, workers=options.workers):
        logs.append(log)
        if not log.success:
            print(f"seed {log.seed}: {log.outcome} after {len(log)} steps, reached {dict(log.milestones)}", flush=True)
    print_table(options.task, options.randomness, logs, time.perf_counter() - begin)


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
        print(f"  steps           {fmean(lengths):6.0f}  ({min(lengths)} to {max(lengths)}, {idle:.1%} of them idle)")
    reached = Counter(name for log in logs for name in log.milestones)
    for name in get_task(task).milestones:
        steps = [log.milestones[name] for log in logs if name in log.milestones]
        print(f"  {name:<16}{reached[name] / len(logs):6.1%}" + (f"  (step {fmean(steps):.0f})" if steps else ""))
    total = sum(len(log) for log in logs)
    print(f"  wall time       {seconds:6.1f} s  ({total / seconds:.0f} steps/s)")


if __name__ == "__main__":
    main()
