"""How far from the corner policies leave the first part of a task.

python -m benchmarks.placing CHECKPOINT ... --task round_table [--randomness med] [--first 700000] [--episodes 100]

The larger of both coordinates, when the next part has been lifted or the episode has ended, whichever comes first.
"""

from __future__ import annotations

import argparse

import numpy as np

from flows.running.data_folder import open_store
from flows.running.settings import read_settings
from juicer.episode import Episode
from juicer.policy_rollout import RolloutConfig, roll_out
from juicer.seed_ranges import Purpose, claim
from juicer.sim.scene import home_xy
from juicer.tasks.registry import get_task
from juicer.tasks.specification import AssemblyTask, Randomness

LIMITS_MM = (2.0, 5.0, 10.0)


def main() -> None:
    """Print a row for every checkpoint."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoints", nargs="+")
    parser.add_argument("--task", required=True)
    parser.add_argument("--randomness", type=Randomness, default=Randomness.MED)
    parser.add_argument("--first", type=int, default=700_000)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--steps", type=int, default=110)
    options = parser.parse_args()
    settings = read_settings()
    store, machine, task = open_store(settings), settings.machine, get_task(options.task)
    config = RolloutConfig(task=task.name, randomness=options.randomness, max_steps=options.steps)
    limits = "  ".join(f"within {limit:.0f} mm" for limit in LIMITS_MM)
    print(f"{'checkpoint':16}  {'median':>7}  {limits}")
    for name in options.checkpoints:
        checkpoint = store.resolve(name, "checkpoint")
        folder = store.open(checkpoint, "checkpoint")
        seeds = claim(Purpose.EVALUATION, options.first, options.episodes)
        episodes = roll_out(
            folder, checkpoint.id, config, seeds, num_envs=machine.num_envs, num_workers=machine.workers
        )
        short_mm = np.array([1000 * distance_from_corner_m(task, episode) for episode in episodes])
        shares = "  ".join(f"{np.mean(short_mm < limit):>11.0%}" for limit in LIMITS_MM)
        print(f"{checkpoint.id:16}  {np.median(short_mm):4.1f} mm  {shares}", flush=True)


def distance_from_corner_m(task: AssemblyTask, episode: Episode) -> float:
    """How far from the corner the first part was left."""
    poses = np.asarray(episode.steps["part_poses"])
    lifted = episode.record.milestones.get(task.pairs[0].milestones[0])
    step = len(poses) - 1 if lifted is None else min(lifted, len(poses) - 1)
    return float(np.abs(poses[step, :2] - home_xy(task.parts[0])).max())


if __name__ == "__main__":
    main()
