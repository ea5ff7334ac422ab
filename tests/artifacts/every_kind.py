"""One small artifact of every kind, its payload written by the code that writes them for a user."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore
from juicer.demonstration.log import OperatorLog, write_log
from juicer.episode import SIMULATOR, ArraySpec, Episode, EpisodeRecord, Outcome, Role, Source
from juicer.imaging.video import write_video
from juicer.policy.backbones.patch_cnn.config import PatchCNNConfig
from juicer.policy.checkpoint import Checkpoint, CheckpointMetadata, save_checkpoint
from juicer.policy.config import FeatureSpec, PairSpec, PolicyConfig
from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
from juicer.policy.encoders.estimated.config import EstimatedConfig, EstimatorConfig
from juicer.policy.encoders.estimated.estimator import build_estimator
from juicer.policy.encoders.estimated.files import save_estimator
from juicer.policy.heads.diffusion.config import DiffusionConfig
from juicer.policy.network import build_policy
from juicer.progress import NullMetricSink
from juicer.reporting.content import ReportData
from juicer.reporting.page import write_page
from juicer.storage.analyses import ModesRow, write_modes
from juicer.storage.annotations import Annotation, write_annotations
from juicer.storage.columns import write_columns
from juicer.storage.curves import CurveWriter
from juicer.storage.dataset import DatasetRow, write_dataset
from juicer.storage.episodes import write_episodes
from juicer.storage.evaluations import EvaluationRow, write_evaluation
from juicer.storage.selections import SelectionRow, write_selection
from juicer.views import View

STEPS = 6
EPISODES_ID = "0123456789abcdef"
FACTS: Mapping[str, Any] = {"task": "one_leg", "randomness": "low", "seed": 1, "parts_assembled": 1}
PAIR = PairSpec(first=0, second=1, target=(0.0, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0))
TASKS = {"toy": FeatureSpec(num_parts=2, pairs=(PAIR,), mounted_m=0.005, mounted_cosine=0.94)}
POLICY = PolicyConfig(head=DiffusionConfig(denoiser=MLPDenoiserConfig(width=8, blocks=1), prediction="sample"))
SMALL = PatchCNNConfig(quarter=8, eighth=8, quarter_blocks=0, eighth_blocks=0, maps=2)
ESTIMATED = EstimatedConfig(
    estimator=EstimatorConfig(views={"wrist": View(camera="wrist", width=8, height=8)}, backbone=SMALL, width=8)
)

Writer = Callable[[Path, Path, Episode], object]
"""Writes a payload into a folder, with a folder for scratch, about an episode."""


def write_every_kind(store: ArtifactStore) -> ArtifactStore:
    """Make an artifact of every kind in a store."""
    episode = make_episode()
    for kind, write in WRITERS.items():
        with store.create(Recipe(f"make {kind}", kind, config={"number": 1})) as draft:
            write(draft.path, draft.scratch, episode)
            draft.summary |= {"episodes": 1, "reason": "made for a test"}
    return store


def make_episode() -> Episode:
    rng = np.random.default_rng(0)
    sizes = {"part_poses": (14,), "sim_state": (12,)}
    steps = {
        spec.name: rng.normal(size=(STEPS, *sizes.get(spec.name, spec.shape))).astype(spec.dtype) for spec in SIMULATOR
    }
    final = {name: steps[name][-1] for name in SIMULATOR.ends}
    return Episode(EpisodeRecord(source=Source.TELEOP, outcome=Outcome.SUCCESS, **FACTS), steps, final)


def write_logs(folder: Path, scratch: Path, episode: Episode) -> None:
    times = {"timestamp_s": np.arange(STEPS) * 0.1, "idle": np.zeros(STEPS, bool)}
    marks = {"device": "hand", "success": True, "outcome": "success"}
    for name in ("0.npz", "1.npz"):
        write_log(folder / name, OperatorLog(**FACTS, **marks, **times, steps=episode.steps, final=episode.final))


def write_demonstrations(folder: Path, scratch: Path, episode: Episode) -> None:
    write_episodes(folder, [episode], {"source": "teleop"})


def write_speed(folder: Path, scratch: Path, episode: Episode) -> None:
    speed = ArraySpec("speed", (1,), "float32", Role.DERIVED)
    values = {"speed": np.random.default_rng(1).normal(size=(STEPS, 1)).astype(np.float32)}
    write_columns(folder, [speed], [values], artifact=EPISODES_ID, episode_ends=np.array([STEPS]))


def write_annotation(folder: Path, scratch: Path, episode: Episode) -> None:
    write_annotations(folder, [Annotation(episode.record.episode_id, 3, 0, "human", 1.0)])


def write_choice(folder: Path, scratch: Path, episode: Episode) -> None:
    write_selection(folder, [SelectionRow(episode.record.episode_id, True, "success")])


def write_index(folder: Path, scratch: Path, episode: Episode) -> None:
    write_dataset(folder, [DatasetRow(EPISODES_ID, episode.record.episode_id, Source.TELEOP, "one_leg", "0/0")])


def write_estimator(folder: Path, scratch: Path, episode: Episode) -> None:
    save_estimator(folder, build_estimator(ESTIMATED, "toy", TASKS["toy"], 0))


def write_checkpoint(folder: Path, scratch: Path, episode: Episode) -> None:
    weights = build_policy(POLICY, TASKS, 0).state_dict()
    metadata = CheckpointMetadata(policy=POLICY, tasks=TASKS, acting_weights="ema", step=1)
    save_checkpoint(folder, Checkpoint(metadata, weights, weights))
    curves = CurveWriter(scratch, NullMetricSink())
    curves.log({"train/loss": 0.5}, 1)
    curves.finish(folder)


def write_measurement(folder: Path, scratch: Path, episode: Episode) -> None:
    (folder / "examples").mkdir()
    write_episodes(folder / "examples", [episode], {"source": "rollout"})
    write_evaluation(folder, [EvaluationRow(0, 1, Outcome.SUCCESS, 1, STEPS, {"inserted": 3})])


def write_modes_table(folder: Path, scratch: Path, episode: Episode) -> None:
    write_modes(folder, [ModesRow(1, 10, 7, 0.4, 0.9, 1.0, 2.5)])


def write_report(folder: Path, scratch: Path, episode: Episode) -> None:
    write_page(ReportData(title="Nothing yet", created=datetime(2026, 1, 1)), folder / "report.html")
    write_video(folder / "success.mp4", [np.full((48, 64, 3), shade, np.uint8) for shade in range(5)])


WRITERS: Mapping[str, Writer] = {
    "logs": write_logs,
    "episodes": write_demonstrations,
    "columns": write_speed,
    "annotations": write_annotation,
    "selection": write_choice,
    "dataset": write_index,
    "estimator": write_estimator,
    "checkpoint": write_checkpoint,
    "evaluation": write_measurement,
    "analysis": write_modes_table,
    "report": write_report,
}
