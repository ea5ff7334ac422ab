"""A report about runs that never took place."""

from __future__ import annotations

import zlib
from datetime import datetime
from typing import cast

import numpy as np
import pytest

from juicer.evaluation import ModelResult, summarise
from juicer.reporting.content import (
    AugmentationYield,
    EpisodeVideo,
    EstimatorErrors,
    EvaluatedEpisode,
    EvaluatedModel,
    Funnel,
    LineageNode,
    Moment,
    NextStep,
    Provenance,
    ReportData,
    TrainingCurve,
)
from juicer.reporting.paper import PAPER_TABLE_VI
from juicer.reporting.setting import Setting
from juicer.reporting.sources import Sources
from juicer.seeding import stream
from juicer.study.material import Measured, TaskStudy
from juicer.study.sections import sections
from juicer.study.success import differences_section

MILESTONES = ("top_placed", "leg_lifted", "leg_upright", "over_hole", "inserted", "screwed")


def model(condition: str, seed: int, rate: float, episodes: int = 100) -> ModelResult:
    draws = stream(seed, condition).random(episodes) < rate
    states = tuple(range(3_000_000, 3_000_000 + episodes))
    return ModelResult(seed=seed, initial_states=states, successes=tuple(bool(draw) for draw in draws))


def curve(condition: str, floor: float, seed: int = 0) -> TrainingCurve:
    label = f"{condition}, seed {seed}"
    steps = np.arange(0, 20_000, 250)
    rng = stream(0, label)
    training = floor + 0.9 * np.exp(-steps / 2500) + 0.004 * rng.random(len(steps))
    validation = np.where(steps % 1000 == 0, training * 1.25, np.nan)
    return TrainingCurve(label, steps, {"training": training, "validation": validation}, condition)


def video(title: str, frames: int = 10) -> EpisodeVideo:
    """A coloured disc that moves; there is no MuJoCo behind it."""
    across, down = np.meshgrid(np.linspace(0, 1, 320), np.linspace(0, 1, 240))
    drawn = [
        np.stack([0.8 * down, 0.5 + 0.3 * across, np.hypot(across - index / frames, down - 0.5) < 0.2], axis=-1)
        for index in range(frames)
    ]
    images = (255 * np.clip(drawn, 0, 1)).astype(np.uint8)
    labels = {2: "top placed", 4: "leg lifted", 5: "leg upright", 7: "inserted", 9: "screwed"}
    return EpisodeVideo(
        title=title,
        caption="TA+CI, seed 0, episode 4, initial state 3000004: success after 423 steps.",
        mp4=b"no real video",
        width=320,
        height=240,
        poster=images[-1],
        moments=tuple(
            Moment(image, 47 * index, 4.7 * index, 0.5 * index, labels.get(index, ""))
            for index, image in enumerate(images)
        ),
    )


def evaluated(condition: str, seed: int, rate: float, episodes: int = 100) -> EvaluatedModel:
    """Every episode of a model; those that fail get half-way."""
    successes = model(condition, seed, rate, episodes).successes
    return EvaluatedModel(
        condition=condition,
        seed=seed,
        evaluation=f"{zlib.crc32(f'{condition}{seed}'.encode()):08x}00000000",
        checkpoint=f"{seed:08x}11111111",
        milestones=MILESTONES,
        episodes=tuple(
            EvaluatedEpisode(
                number=index,
                initial_state=3_000_000 + index,
                outcome="success" if succeeded else ("timeout" if index % 4 else "part lost"),
                parts_assembled=int(succeeded),
                steps=423 if succeeded else 650,
                milestones={name: 60 * (place + 1) for place, name in enumerate(MILESTONES[: 6 if succeeded else 3])},
            )
            for index, succeeded in enumerate(successes)
        ),
        lineage=lineage()[:4],
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
    bc = summarise("bc", [model("BC", 0, 0.52)], "BC")
    best = summarise("ta_ci", [model("TA+CI", 0, 0.92)], "TA+CI")
    unread = cast(Sources, None)
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
        sections=sections(
            [TaskStudy("one_leg", {each.condition: Measured(each, Setting(), "", ()) for each in (bc, best)}, unread)],
            (differences_section,),
        ),
        funnels=(
            Funnel("BC", 100, dict(zip(MILESTONES, (97, 88, 84, 71, 55, 52), strict=True))),
            Funnel("TA+CI", 100, dict(zip(MILESTONES, (100, 99, 98, 96, 93, 92), strict=True))),
        ),
        curves=tuple(curve(name, floor) for name, floor in (("BC", 0.02), ("TA", 0.018), ("TA+CI", 0.012))),
        augmentations=(
            AugmentationYield(
                "50 demonstrations", 150, {"did_not_return": 31, "part_dropped": 12}, {"insert leg": (150, 193)}
            ),
        ),
        estimators=(EstimatorErrors("one_leg", {"insert leg": (0.94, 1.3)}),),
        videos=(video("A success"), video("A typical failure")),
        models=(evaluated("BC", 0, 0.52), evaluated("TA+CI", 0, 0.92)),
        lineage=lineage(),
        provenance=Provenance(
            facts={"Evaluated at commit": "2b0e8fd4b356c8be3a411328cb7838f5ec18956c", "Evaluated on": "host: 2 CPUs"},
            configuration="flow: study\nname: one_leg\n",
            file_name="one_leg.yaml",
            commands=("git checkout 2b0e8fd4b356c8be3a411328cb7838f5ec18956c", "juicer run one_leg.yaml"),
            links={"MLflow": "https://mlflow.example.org/#/experiments"},
        ),
        next_steps=(
            NextStep("Watch a rollout", "juicer replay episodes/f1b2c3d4 --episode 4 --video rollout.mp4"),
            NextStep("Open both web interfaces", "juicer ui"),
        ),
    )
