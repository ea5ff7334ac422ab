"""How long a training step takes for each preset, how much of it goes into gathering windows, and how fast it acts.

The data are synthetic, in the sizes of 50 one_leg demonstrations. Run it on an otherwise idle machine:

    python benchmarks/training_throughput.py [--presets laptop smoke paper] [--steps 30]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from statistics import median

import numpy as np
import torch

from flows.runs import load_runs
from flows.shipped import PRESETS
from juicer.geometry import matrix_to_rot6d, normalised, quat_to_matrix
from juicer.policy.acting import TrainedPolicy
from juicer.policy.config import FeatureSpec, PairSpec
from juicer.policy.network import build_policy
from juicer.policy.torch_settings import compute_settings
from juicer.tasks.specification import MOUNTED_COSINE, MOUNTED_M
from juicer.training.feed import Feed
from juicer.training.learner import Learner
from juicer.training.source import BatchOrder
from juicer.training.trainer import Imitation, cut_sides
from juicer.training.windows import TrainingEpisodes
from stages.train import TrainConfig

NUM_EPISODES, NUM_STEPS, NUM_PARTS = 50, 500, 5
SPEC = FeatureSpec(
    num_parts=NUM_PARTS,
    pairs=(PairSpec(first=0, second=4, target=(0.05625, 0.046875, 0.05625, 1.0, 0.0, 0.0, 0.0)),),
    mounted_m=MOUNTED_M,
    mounted_cosine=MOUNTED_COSINE,
)


def synthetic_episodes(seed: int = 0) -> TrainingEpisodes:
    """Episodes whose numbers mean nothing but have the shapes and ranges of real ones."""
    rng = np.random.default_rng(seed)
    total = NUM_EPISODES * NUM_STEPS

    def poses() -> np.ndarray:
        position = rng.uniform([0.3, -0.3, 0.0], [0.7, 0.3, 0.3], size=(total, 3))
        return np.concatenate([position, normalised(rng.normal(size=(total, 4)))], axis=1)

    def rotated(pose: np.ndarray) -> np.ndarray:
        return np.concatenate([pose[:, :3], matrix_to_rot6d(quat_to_matrix(pose[:, 3:]))], axis=1)

    gripper = rotated(poses())
    observations = {
        "proprioception": np.concatenate([gripper, rng.normal(size=(total, 7))], axis=1).astype(np.float32),
        "part_poses": np.concatenate([poses() for _ in range(NUM_PARTS)], axis=1).astype(np.float32),
    }
    actions = np.concatenate([rotated(poses()), rng.choice([-1, 1], size=(total, 1))], axis=1).astype(np.float32)
    ends = np.arange(1, NUM_EPISODES + 1) * NUM_STEPS
    families = [str(index) for index in range(NUM_EPISODES)]
    return TrainingEpisodes(observations, actions, ends, families, ["teleop"] * NUM_EPISODES)


def measure_training(episodes: TrainingEpisodes, preset: TrainConfig, steps: int) -> dict[str, float]:
    """Median milliseconds of CPU time a training step, and of the gathering within it."""
    device, config = torch.device("cpu"), preset.training
    network = build_policy(preset.policy, {"toy": SPEC}, seed=0)
    sides = cut_sides(episodes, preset.policy.horizons, config, seed=0)
    windows = Imitation(episodes, sides, network, config, seed=0).window_sources(device)
    learner = Learner(network, config, device)
    feed = Feed(
        windows.learned, BatchOrder(len(windows.learned), config.batch_size, seed=0), config.state_noise, seed=0
    )
    sampling, whole = [], []
    for step in range(steps + 3):
        start = time.process_time()
        batch = feed.gather(step)
        sampled = time.process_time()
        learner.learn(batch, step)
        sampling.append(sampled - start)
        whole.append(time.process_time() - start)
    # The first steps pay for allocations and the first shuffle.
    share = sum(sampling[3:]) / sum(whole[3:])
    return {"parameters": network.num_parameters, "ms": 1000 * median(whole[3:]), "sampling": share}


def measure_acting(preset: TrainConfig, episodes: TrainingEpisodes, num_rows: int, repeats: int) -> float:
    """Median milliseconds of CPU time to choose the next actions of ``num_rows`` episodes."""
    policy = TrainedPolicy(build_policy(preset.policy, {"toy": SPEC}, seed=0), "toy", preset.training.threads)
    observations = {name: values[:num_rows] for name, values in episodes.observations.items()}
    streams = [np.random.default_rng(row) for row in range(num_rows)]
    policy.predict(observations, streams)
    return 1000 * median(_timed(lambda: policy.predict(observations, streams)) for _ in range(repeats))


def _timed(call: Callable[[], object]) -> float:
    start = time.process_time()
    call()
    return time.process_time() - start


def main() -> None:
    """Print one row a policy."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--presets", nargs="+", default=["laptop", "smoke"])
    parser.add_argument("--steps", type=int, default=30)
    arguments = parser.parse_args()
    episodes = synthetic_episodes()
    print("CPU milliseconds, one thread; 'act n': to choose the next actions of n episodes")
    heads = ("preset", "policy", "parameters", "batch", "ms/step", "samples/s", "sampling", "act 1", "act 16", "act 32")
    print("{:8} {:14} {:>11} {:>5} {:>8} {:>9} {:>8} {:>7} {:>7} {:>7}".format(*heads))
    for name in arguments.presets:
        (run,) = load_runs(PRESETS / f"{name}.yaml")
        for policy, preset in run.policies.items():
            with compute_settings(preset.training.threads, "medium"):
                row = measure_training(episodes, preset, arguments.steps)
            acting = [measure_acting(preset, episodes, num_rows, 5) for num_rows in (1, 16, 32)]
            rate = 1000 * preset.training.batch_size / row["ms"]
            print(
                f"{name:8} {policy:14} {row['parameters']:>11,} {preset.training.batch_size:>5} {row['ms']:>8.1f} "
                f"{rate:>9,.0f} {row['sampling']:>8.1%} " + " ".join(f"{ms:>7.1f}" for ms in acting),
                flush=True,
            )


if __name__ == "__main__":
    main()
