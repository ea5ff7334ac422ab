"""The paper's policy on a device: how fast it trains there, what it occupies, and how long 160,000 steps take.

Records demonstrations of one_leg, trains a preset's diffusion policy on them for some steps and evaluates it: one model
of condition `bc`, as `juicer run` makes it, with images drawn and encoded where the preset has them. On a machine with
a GPU:

    python -m benchmarks.paper_scale --preset paper
    python -m benchmarks.paper_scale --preset paper_image --training precision=bf16 memory_format=channels_last
    python -m benchmarks.paper_scale --preset paper_image --device cuda:0,cuda:1 --processes 2

Where the weights of ImageNet are missing, which `paper_image` starts from, random ones train as fast: add
`--set policies.diffusion.policy.observation.eyes.backbone.weights=null`.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import torch

from flows.config import RunConfig
from flows.loop import run_model
from flows.running.plan import plan, require_weights
from flows.running.settings import read_settings
from flows.runs import parse_runs
from juicer.artifacts.store import ArtifactStore
from stages.runtime.context import NoRecord
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session

PAPER_STEPS = 160_000


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


def configured(options: argparse.Namespace) -> RunConfig:
    """One model of the preset, trained for a few steps."""
    steps = {
        "policies.diffusion.training.steps": options.steps,
        "policies.diffusion.training.warmup_steps": options.steps // 10,
        "policies.diffusion.training.report_every": 20,
        "record.demonstrations": options.demonstrations,
        "evaluate.episodes": options.episodes,
        "evaluate.max_steps": options.max_steps,
    }
    overrides = [
        *(f"{key}={value}" for key, value in steps.items()),
        *(f"policies.diffusion.training.{each}" for each in options.training),
        *options.set,
    ]
    (config,) = parse_runs({"base": options.preset, "condition": "bc"}, "the preset", overrides)
    return config


def arguments() -> argparse.Namespace:
    """What was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="paper")
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--processes", type=int, default=1, help="that train the policy, each on a device")
    parser.add_argument("--loaders", type=int, help="processes that gather the batches of each")
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--demonstrations", type=int, default=6)
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--max-steps", type=int, default=80)
    parser.add_argument("--training", nargs="+", default=[], metavar="KEY=VALUE", help="other settings of training")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="any other setting; repeatable")
    return parser.parse_args()


def main() -> None:
    """Print a table."""
    options = arguments()
    config, clock, is_gpu = configured(options), Clock(), options.device != "cpu"
    machine = Machine(
        os.cpu_count() or 1,
        num_envs=min(options.episodes, 32),
        devices=tuple(options.device.split(",")),
        processes=options.processes,
        loaders=options.loaders,
        weights=read_settings().machine.weights,
    )
    with tempfile.TemporaryDirectory() as folder:
        session = Session(ArtifactStore(Path(folder)), perform_here, record=clock, machine=machine)
        require_weights(plan(session.store, config), machine.weights)
        outcome = run_model(session, config, "bc", seed=0)
        trained, evaluated = (session.store.manifest(ref).summary for ref in (outcome.checkpoint, outcome.evaluation))
    losses = [entry for entry in clock.reports if "train/loss" in entry[2]]
    # The first report pays for compilation and for filling what is gathered ahead.
    (first, first_time, begin), (last, last_time, end) = losses[1], losses[-1]
    rate = (last - first) / (last_time - first_time)
    rows = {
        "preset": " ".join([options.preset, *options.training, *options.set]),
        "device": torch.cuda.get_device_name() if is_gpu else "cpu",
        "processes": options.processes,
        "precision": trained["precision"],
        "parameters": f"{trained['num_parameters'] / 1e6:.2f} M",
        "training steps/s": f"{rate:.2f}, validations and saves included",
        f"hours of {PAPER_STEPS:,}": f"{PAPER_STEPS / rate / 3600:.1f}",
        "loss": f"{begin['train/loss']:.4f} at step {first}, {end['train/loss']:.4f} at step {last}",
        "success": f"{evaluated['successes']} of {evaluated['episodes']} episodes",
    }
    if is_gpu and options.processes == 1:
        rows["GPU memory at most"] = f"{torch.cuda.max_memory_allocated() / 2**30:.2f} GiB"
    for name, value in rows.items():
        print(f"{name:20} {value}")


if __name__ == "__main__":
    main()
