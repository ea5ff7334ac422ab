"""How long a policy takes to choose an action chunk, and how often it succeeds, by the steps in which it samples.

Success is measured by the stage `evaluate`, so a rate that the store has is not computed again. For one row of the
table, an episode runs alone and every chunk is timed: CPU time of one thread, for the row itself (`1 row`), and as the
policy acts, which fills every batch up to 16 rows (`acting`).

    juicer run benchmarks/latency.yaml
    python -m benchmarks.latency CHECKPOINT[:STEPS,...] ... [--episodes 50]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from flows.running.data_folder import open_store
from flows.running.settings import read_settings
from juicer.artifacts.ref import ArtifactRef
from juicer.episode import ACTION_SIZE
from juicer.policy.acting import TrainedPolicy
from juicer.policy.checkpoint import load_checkpoint
from juicer.policy.network import PolicyNetwork
from juicer.policy.torch_settings import compute_settings
from juicer.rollout import rollout
from juicer.seed_ranges import Purpose, claim
from juicer.tasks.specification import Randomness
from stages.evaluate import EvaluateConfig, evaluate
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session

ROW = "{:16} {:18} {:>5} {:>8} {:>8} {:>8} {:>8}  {}"


class Stopwatch:
    """A policy that acts in one episode, and notes how long each chunk takes."""

    def __init__(self, network: PolicyNetwork, task: str) -> None:
        self._network = network
        self._policy = TrainedPolicy(network, task)
        self.observations = self._policy.observations
        self.obs_horizon, self.action_horizon = self._policy.obs_horizon, self._policy.action_horizon
        self.milliseconds: dict[str, list[float]] = {"1 row": [], "acting": []}

    def predict(
        self, observations: Mapping[str, NDArray[Any]], streams: Sequence[np.random.Generator]
    ) -> NDArray[np.float32]:
        """See :class:`juicer.rollout.Policy`."""
        row = {name: torch.from_numpy(values) for name, values in observations.items()}
        noise = torch.randn(1, self._network.config.horizons.pred, ACTION_SIZE)
        with torch.inference_mode(), compute_settings(1, "highest"):
            begun = time.thread_time()
            self._network.predict(row, noise)
            self.milliseconds["1 row"].append(1000 * (time.thread_time() - begun))
        begun = time.thread_time()
        chunk = self._policy.predict(observations, streams)
        self.milliseconds["acting"].append(1000 * (time.thread_time() - begun))
        return chunk


def measure(session: Session, checkpoint: ArtifactRef, steps: int | None, episodes: int) -> str:
    """A row of the table."""
    loaded = load_checkpoint(session.store.open(checkpoint, "checkpoint"))
    (task,) = loaded.metadata.tasks
    network = loaded.network(steps)
    watch = Stopwatch(network, task)
    list(rollout(watch, task, Randomness.LOW.value, claim(Purpose.EVALUATION, 0, 1), num_envs=1))
    times = [quantile for each in watch.milliseconds.values() for quantile in np.quantile(each[1:], [0.5, 0.95])]
    config = EvaluateConfig(task=task, randomness=Randomness.LOW, episodes=episodes, inference_steps=steps)
    found = session.store.manifest(evaluate(session, checkpoint=checkpoint, config=config)).summary
    rate = (
        f"{found['successes']:3} of {found['episodes']} ({found['interval_low']:.0%} to {found['interval_high']:.0%})"
    )
    head = network.config.head
    told = getattr(head, "inference_steps", "")
    return ROW.format(checkpoint.id, head.kind, told, *(f"{each:.2f}" for each in times), rate)


def main() -> None:
    """Print a row for every checkpoint and number of steps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoints", nargs="+", metavar="CHECKPOINT[:STEPS,...]")
    parser.add_argument("--episodes", type=int, default=50)
    arguments = parser.parse_args()
    settings = read_settings()
    session = Session(open_store(settings), perform_here, machine=Machine(workers=1, num_envs=16))
    print(ROW.format("checkpoint", "head", "steps", "1 row ms", "95 %", "acting", "95 %", "success"))
    for text in arguments.checkpoints:
        name, _, steps = text.partition(":")
        checkpoint = session.store.resolve(name, "checkpoint")
        for number in steps.split(",") if steps else [None]:
            print(measure(session, checkpoint, number and int(number), arguments.episodes), flush=True)


if __name__ == "__main__":
    main()
