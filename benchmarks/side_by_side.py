"""What a control step of a rollout costs by how many environments run side by side.

python -m benchmarks.side_by_side CHECKPOINT [--numbers 16,4,8,32] [--episodes 32] [--steps 16]

CPU time of simulation and policy together, one thread of environments, the same episodes each time.
"""

from __future__ import annotations

import argparse
import time

from flows.running.data_folder import open_store
from flows.running.settings import read_settings
from juicer.policy_rollout import RolloutConfig, roll_out
from juicer.seed_ranges import Purpose, claim
from juicer.tasks.specification import Randomness


def main() -> None:
    """Print a row for every number of environments."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint")
    parser.add_argument("--task", default="one_leg")
    parser.add_argument("--numbers", default="16,4,8,32")
    parser.add_argument("--episodes", type=int, default=32)
    parser.add_argument("--steps", type=int, default=16)
    options = parser.parse_args()
    store = open_store(read_settings())
    checkpoint = store.resolve(options.checkpoint, "checkpoint")
    folder = store.open(checkpoint, "checkpoint")
    config = RolloutConfig(task=options.task, randomness=Randomness.LOW, max_steps=options.steps)

    def seconds_a_step(num_envs: int, episodes: int) -> float:
        begun = time.process_time()
        seeds = claim(Purpose.EVALUATION, 0, episodes)
        runs = roll_out(folder, checkpoint.id, config, seeds, num_envs=num_envs, num_workers=1)
        steps = sum(map(len, runs))
        return (time.process_time() - begun) / steps

    seconds_a_step(1, 1)  # loads all that is loaded once
    for number in map(int, options.numbers.split(",")):
        print(f"{number:4} side by side: {1000 * seconds_a_step(number, options.episodes):.2f} ms a control step")


if __name__ == "__main__":
    main()
