"""How fast images are stored, unpacked and gathered by windows, as against how fast a training step uses them up.

    python -m benchmarks.image_windows [--size 96] [--steps 4000] [--folder FOLDER]

Draws a scripted one_leg demonstration for the front and the wrist camera, repeats it to the number of steps, writes and
unpacks it as a training does, and gathers batches at random; then takes a few training steps on such batches, with one
patch_cnn a view and with one ResNet18 a view.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.training_throughput import SPEC
from juicer.demonstration.recording import record_demonstration
from juicer.episode import Episode, EpisodeRecord, Outcome, Source
from juicer.expert.operator import ScriptedOperator
from juicer.imaging.recorded import drawing_of
from juicer.policy.config import PolicyConfig
from juicer.policy.network import build_policy
from juicer.policy.torch_settings import compute_settings
from juicer.seeding import stream
from juicer.sim.env import AssemblyEnv
from juicer.storage.columns import write_columns
from juicer.storage.dataset import DatasetRow
from juicer.storage.episodes import EpisodeReader, write_episodes
from juicer.training.config import TrainingConfig
from juicer.training.images import Chosen, unpack_images
from juicer.training.learner import Learner
from juicer.training.reading import read_episodes
from juicer.training.source import BatchOrder
from juicer.training.table import WindowTable
from juicer.training.windows import TrainingEpisodes, cut_windows
from juicer.views import View

ARTIFACT = "0123456789abcdef"
BATCH = 64
BACKBONES: Mapping[str, Mapping[str, Any]] = {"patch_cnn": {"kind": "patch_cnn"}, "ResNet18": {"kind": "resnet"}}


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=96, help="pixels of each side")
    parser.add_argument("--steps", type=int, default=4000, help="steps that are written and unpacked")
    parser.add_argument("--folder", type=Path, default=None, help="where to write; a temporary one if left out")
    options = parser.parse_args()
    views = {camera: View(camera=camera, width=options.size, height=options.size) for camera in ("front", "wrist")}
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        episodes = stored(Path(folder), views, options.steps)
        for name, backbone in BACKBONES.items():
            consume(name, episodes, policy_of(views, backbone))


def stored(folder: Path, views: Mapping[str, View], steps: int) -> TrainingEpisodes:
    """Episodes of images, written and unpacked as a run does."""
    one = demonstration()
    copies = [
        dataclasses.replace(one, record=dataclasses.replace(one.record, seed=seed, episode_id=""))
        for seed in range(max(1, round(steps / len(one))))
    ]
    place = folder / "episodes" / ARTIFACT
    place.mkdir(parents=True)
    write_episodes(place, copies, {})
    reader = EpisodeReader(place)
    columns = []
    for name, view in views.items():
        columns.append(folder / "columns" / name)
        columns[-1].mkdir(parents=True)
        with drawing_of(reader, (view,), workers=1) as drawing:
            images = next(drawing.episodes())[view.name]
        total = len(images) * len(copies)
        write = timed(
            lambda view=view, images=images, place=columns[-1]: write_columns(
                place,
                [view.column],
                ({view.name: images} for _ in copies),
                artifact=ARTIFACT,
                episode_ends=reader.episode_ends,
            )
        )
        size = sum(path.stat().st_size for path in columns[-1].rglob("*") if path.is_file())
        print(
            f"{view}: {1000 * write / total:.2f} ms CPU an image written, {images.nbytes * len(copies) / size:.1f} "
            "times smaller than raw"
        )
    reader = EpisodeReader(place, columns)
    rows = [
        DatasetRow(ARTIFACT, record.episode_id, Source.TELEOP, "toy", str(number))
        for number, record in enumerate(reader.records)
    ]
    unpacked: dict[str, NDArray[np.uint8]] = {}
    specs = [view.observed() for view in views.values()]
    spent = timed(lambda: unpacked.update(unpack_images([Chosen(reader, rows)], specs, folder / "unpacked")))
    volume = sum(images.nbytes for images in unpacked.values())
    print(f"unpacking: {volume / 1e6 / spent:,.0f} MB/s of CPU")
    read = read_episodes(reader, rows, {"toy": SPEC}, ["proprioception"])
    return dataclasses.replace(read, observations={**read.observations, **unpacked})


def demonstration() -> Episode:
    """What the scripted operator does."""
    env = AssemblyEnv("one_leg")
    log = record_demonstration(env, ScriptedOperator(env.task, stream(0, "operator", 0)), 0)
    record = EpisodeRecord(Source.TELEOP, "one_leg", "low", 0, Outcome.SUCCESS)
    return Episode(record, dict(log.steps), dict(log.final))


def policy_of(views: Mapping[str, View], backbone: Mapping[str, Any]) -> PolicyConfig:
    """A policy that looks, with a small head: what is measured is its encoder."""
    images = {"kind": "images", "views": dict(views), "backbone": dict(backbone)}
    head = {"kind": "mlp", "width": 128, "blocks": 1}
    return PolicyConfig.model_validate({"observation": {"images": images}, "head": head})


def consume(name: str, episodes: TrainingEpisodes, policy: PolicyConfig) -> None:
    """Windows a second that are gathered, and that a training step takes."""
    device, config = torch.device("cpu"), TrainingConfig(batch_size=BATCH, precision="auto", steps=1000)
    network = build_policy(policy, {"toy": SPEC}, seed=0)
    windows = cut_windows(episodes.episode_ends, np.arange(len(episodes.episode_ends)), policy.horizons, 7)
    table = WindowTable(episodes, windows, network, learn_padding=True, device=device)
    table.fit()
    table.normalize()
    order = BatchOrder(len(table), BATCH, seed=0)
    learner = Learner(network, config, device)
    with compute_settings(config.threads, "medium"):
        gather = min(timed(lambda step=step: table.gather(order.rows(step))) for step in range(20))
        batch = table.gather(order.rows(0))
        learn = min(timed(lambda step=step: learner.learn(batch, step)) for step in range(4))
    print(
        f"{name}: {BATCH / gather:,.0f} windows gathered a second of CPU, {BATCH / learn:,.1f} learned from "
        f"({learner.precision}); {learn / gather:,.0f} times as fast"
    )


def timed(action: Callable[[], Any]) -> float:
    """Seconds of CPU."""
    start = time.process_time()
    action()
    return time.process_time() - start


if __name__ == "__main__":
    main()
