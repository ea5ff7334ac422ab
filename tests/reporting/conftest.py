"""A report about runs that never took place."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pytest

from juicer.evaluation import PAPER_TABLE_VI, ModelResult, compare, summarise
from juicer.reporting.content import (
    AugmentationYield,
    DatasetSize,
    FilmStrip,
    Funnel,
    LineageNode,
    NextStep,
    ReportData,
    StageCost,
    TrainingCurve,
)
from juicer.seeding import stream

MILESTONES = ("top_placed", "leg_lifted", "leg_upright", "over_hole", "inserted", "screwed")


def model(condition: str, seed: int, rate: float, episodes: int = 100) -> ModelResult:
    draws = stream(seed, condition).random(episodes) < rate
    states = tuple(range(3_000_000, 3_000_000 + episodes))
    return ModelResult(seed=seed, initial_states=states, successes=tuple(bool(draw) for draw in draws))


def curve(label: str, floor: float) -> TrainingCurve:
    steps = np.arange(0, 20_000, 250)
    rng = stream(0, label)
    training = floor + 0.9 * np.exp(-steps / 2500) + 0.004 * rng.random(len(steps))
    validation = np.where(steps % 1000 == 0, training * 1.25, np.nan)
    return TrainingCurve(label, steps, {"training": training, "validation": validation})


def film(title: str, frames: int = 10) -> FilmStrip:
    across, down = np.meshgrid(np.linspace(0, 1, 320), np.linspace(0, 1, 240))
    pictures = [
        np.stack([0.8 * down, 0.5 + 0.3 * across, np.hypot(across - index / frames, down - 0.5) < 0.2], axis=-1)
        for index in range(frames)
    ]
    return FilmStrip(
        title=title,
        caption="TA+CI, seed 0, initial state 3000004, front camera.",
        frames=(255 * np.clip(pictures, 0, 1)).astype(np.uint8),
        seconds=tuple(4.7 * index for index in range(frames)),
        labels={2: "top_placed", 4: "leg_lifted", 5: "leg_upright", 7: "inserted", 9: "screwed"},
    )


def lineage() -> tuple[LineageNode, ...]:
    def node(kind: str, number: int, label: str, *parents: LineageNode) -> LineageNode:
        return LineageNode(f"{kind}/{number:016x}", kind, label, tuple(parent.id for parent in parents))

    logs = node("episodes", 0xA1B2C3D4E5F60718, "50 demonstrations")
    labels = node("annotations", 0xB1B2C3D4E5F60718, "50 critical states", logs)
    corrective = node("episodes", 0xC1B2C3D4E5F60718, "150 corrective snippets", logs, labels)
    bc = node("checkpoint", 0xD1B2C3D4E5F60718, "BC, seed 0", logs)
    augmented = node("checkpoint", 0xE1B2C3D4E5F60718, "TA, seed 0", logs, corrective)
    rollouts = node("episodes", 0xF1B2C3D4E5F60718, "100 rollouts of TA", augmented)
    chosen = node("selection", 0x11B2C3D4E5F60718, "83 successes", rollouts)
    final = node("checkpoint", 0x21B2C3D4E5F60718, "TA+CI, seed 0", logs, corrective, rollouts, chosen)
    evaluations = [
        node("evaluation", 0x31B2C3D4E5F60718 + index, f"{trained.label.split(',')[0]}: 100 episodes", trained)
        for index, trained in enumerate((bc, final))
    ]
    return (logs, labels, corrective, bc, augmented, rollouts, chosen, final, *evaluations)


@pytest.fixture
def report_data() -> ReportData:
    """Everything filled in, for two conditions."""
    bc = summarise("BC", [model("BC", 0, 0.52)])
    best = summarise("TA+CI", [model("TA+CI", 0, 0.92)])
    return ReportData(
        title="one_leg, low randomness",
        created=datetime(2026, 11, 22, 9, 30),
        facts={
            "preset": "laptop",
            "demonstrations": "50, scripted teleoperator",
            "seeds": "0",
            "evaluation": "100 episodes a model",
            "version": "0.1.0",
            "machine": "2 cores, no GPU",
        },
        findings=("CI had no successful rollout in round 1 of seed 0, so it was not retrained.",),
        results=(bc, best),
        paper=PAPER_TABLE_VI["one_leg"],
        comparisons=(compare(bc, best),),
        funnels=(
            Funnel("BC", 100, dict(zip(MILESTONES, (97, 88, 84, 71, 55, 52), strict=True))),
            Funnel("TA+CI", 100, dict(zip(MILESTONES, (100, 99, 98, 96, 93, 92), strict=True))),
        ),
        curves=tuple(
            curve(f"{name}, seed 0", floor) for name, floor in (("BC", 0.02), ("TA", 0.018), ("TA+CI", 0.012))
        ),
        augmentations=(
            AugmentationYield(
                "50 demonstrations", 150, {"did_not_return": 31, "part_dropped": 12}, {"insert leg": (150, 193)}
            ),
        ),
        datasets=(
            DatasetSize("BC", {"teleop": 50}, {"teleop": 28_900}),
            DatasetSize(
                "TA+CI",
                {"teleop": 50, "rollout": 83, "augmentation": 150},
                {"teleop": 28_900, "rollout": 44_120, "augmentation": 8_250},
            ),
        ),
        films=(film("A success"), film("A typical failure")),
        lineage=lineage(),
        costs=(
            StageCost("ingest", 1, 4.2, 18.5),
            StageCost("augment", 1, 61.0, 12.1),
            StageCost("train", 3, 1260.0, 14.9),
            StageCost("evaluate", 2, 181.0, 0.1),
        ),
        next_steps=(
            NextStep("Watch a rollout", "juicer replay episodes/f1b2c3d4 --episode 4 --video rollout.mp4"),
            NextStep("Open both web interfaces", "juicer ui"),
        ),
    )
