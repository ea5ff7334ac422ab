"""The paper's policy on one device: how fast it trains and acts there, and what it occupies.

Records demonstrations of one_leg, trains the preset `paper`'s diffusion policy on them for some steps and evaluates the
checkpoint, all through the stages that `juicer run` calls. On a machine with a GPU:

    python -m benchmarks.paper_scale --device cuda [--steps 300] [--demonstrations 6] [--episodes 8] [--max-steps 80]
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import torch

from flows.config import parse_runs
from juicer.artifacts.store import ArtifactStore
from juicer.demonstration.ingestion import IngestionConfig
from juicer.training.mixing import DatasetConfig
from stages.dataset import dataset
from stages.evaluate import EvaluateConfig, evaluate
from stages.ingest import ingest
from stages.record import RecordConfig, record
from stages.runtime.context import NoRecord
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session
from stages.train import train

TASK = {"task": "one_leg", "randomness": "low"}


class Clock(NoRecord):
    """Notes when each report of a training came."""

    def __init__(self) -> None:
        self.reports: list[tuple[int, float, Mapping[str, float]]] = []

    def metrics(self, stage: str) -> Clock:
        """All numbers of all stages."""
        return self

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        """Note a report."""
        self.reports.append((step, time.perf_counter(), dict(metrics)))


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--demonstrations", type=int, default=6)
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--max-steps", type=int, default=80)
    arguments = parser.parse_args()
    (config,) = parse_runs({"base": "paper", "condition": "bc"}, "the preset")
    config = config.policies["diffusion"]
    training = config.training.model_copy(
        update={"steps": arguments.steps, "warmup_steps": arguments.steps // 10, "report_every": 20}
    )
    clock = Clock()
    with tempfile.TemporaryDirectory() as folder:
        session = Session(
            ArtifactStore(Path(folder)),
            perform_here,
            record=clock,
            machine=Machine(os.cpu_count() or 1, num_envs=min(arguments.episodes, 32), devices=(arguments.device,)),
        )
        logs = record(session, config=RecordConfig(**TASK, demonstrations=arguments.demonstrations))
        demonstrations = ingest(session, logs=logs, config=IngestionConfig(task="one_leg"))
        mixed = dataset(session, episodes=(demonstrations,), config=DatasetConfig())
        checkpoint = train(session, dataset=mixed, config=config.model_copy(update={"training": training}))
        memory = torch.cuda.max_memory_allocated() / 2**30 if arguments.device != "cpu" else 0.0
        begun = time.perf_counter()
        scope = EvaluateConfig(**TASK, episodes=arguments.episodes, max_steps=arguments.max_steps)
        evaluation = evaluate(session, checkpoint=checkpoint, config=scope)
        acted = time.perf_counter() - begun
        summary, found = (session.store.manifest(ref).summary for ref in (checkpoint, evaluation))
        losses = [entry for entry in clock.reports if "train/loss" in entry[2]]
        (first, first_time, begin), (last, last_time, end) = losses[1], losses[-1]
        rows = {
            "device": torch.cuda.get_device_name() if arguments.device != "cpu" else "cpu",
            "parameters": f"{summary['num_parameters'] / 1e6:.2f} M",
            "training steps/s": f"{(last - first) / (last_time - first_time):.1f}",
            "loss": f"{begin['train/loss']:.4f} at step {first}, {end['train/loss']:.4f} at step {last}",
            "GPU memory at most": f"{memory:.2f} GiB",
            "success": f"{found['successes']} of {found['episodes']} episodes, {acted:.1f} s",
        }
    for name, value in rows.items():
        print(f"{name:20} {value}")


if __name__ == "__main__":
    main()
