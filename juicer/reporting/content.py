"""What a report says, as plain data: the page knows no store, no orchestrator and no tracker.

Every part but the title may be left empty; the page then omits its section.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from juicer.evaluation import ConditionResult, PairedComparison


@dataclass(frozen=True)
class Funnel:
    """How far the episodes of a condition got.

    Attributes:
        condition: Name of the condition, as in its :class:`~juicer.evaluation.ConditionResult`.
        num_episodes: Episodes evaluated.
        reached: Episodes that reached each milestone, in the task's order; the last one is success.
    """

    condition: str
    num_episodes: int
    reached: Mapping[str, int]


@dataclass(frozen=True)
class TrainingCurve:
    """One training run.

    Attributes:
        label: What was trained, e.g. ``TA+CI, seed 0, round 1``.
        steps: Optimiser steps at which the losses were taken ``(K,)``.
        losses: Named curves ``(K,)`` over the steps, e.g. ``training`` and ``validation``; NaN where not measured.
    """

    label: str
    steps: NDArray[np.integer]
    losses: Mapping[str, NDArray[np.floating]]


@dataclass(frozen=True)
class AugmentationYield:
    """What became of the corrective trajectories that were tried.

    Attributes:
        label: Which augmentation, e.g. ``50 demonstrations``.
        kept: Snippets kept.
        rejected: Rejected snippets by reason.
        by_critical_state: Snippets kept and attempts, by name of the critical state.
    """

    label: str
    kept: int
    rejected: Mapping[str, int]
    by_critical_state: Mapping[str, tuple[int, int]] = field(default_factory=dict)


@dataclass(frozen=True)
class DatasetSize:
    """What a condition was trained on, in the form of the paper's Table V.

    Attributes:
        condition: Name of the condition.
        episodes: Episodes by source (``teleop``, ``rollout``, ``augmentation``), mean over its models.
        timesteps: Timesteps by source, mean over its models.
        unused: Those of them at which no training window begins, as their episodes are too short for one.
    """

    condition: str
    episodes: Mapping[str, float]
    timesteps: Mapping[str, float]
    unused: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class FilmStrip:
    """Moments of one episode.

    Attributes:
        title: E.g. ``Success``.
        caption: Which policy and initial state, and what to see.
        frames: Pictures in order of time ``(F, H, W, 3)`` uint8.
        seconds: Simulated time of each frame since reset ``(F,)``.
        labels: What happens in a frame, by index of the frame, e.g. a milestone's name.
    """

    title: str
    caption: str
    frames: NDArray[np.uint8]
    seconds: tuple[float, ...]
    labels: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class LineageNode:
    """An artifact.

    Attributes:
        id: ``kind/id``; unique.
        kind: ``episodes``, ``annotations``, ``selection``, ``checkpoint`` or ``evaluation``.
        label: What it is, for people, e.g. ``50 demonstrations``.
        parents: Ids of the artifacts it was made from.
    """

    id: str
    kind: str
    label: str
    parents: tuple[str, ...] = ()


@dataclass(frozen=True)
class StageCost:
    """What one stage cost.

    Attributes:
        stage: Its name.
        artifacts: Artifacts it made.
        seconds: Wall time of making them, in this run or in an earlier one.
        megabytes: Size of its artifacts.
    """

    stage: str
    artifacts: int
    seconds: float
    megabytes: float


@dataclass(frozen=True)
class NextStep:
    """Something worth doing next.

    Attributes:
        purpose: What it shows or does.
        command: To be typed as it stands.
    """

    purpose: str
    command: str


@dataclass(frozen=True)
class ReportData:
    """Everything the page shows.

    Attributes:
        title: Headline, e.g. ``one_leg, low randomness``.
        created: When the run ended.
        facts: Setting of the run in a few name-value pairs: preset, demonstrations, machine, version.
        findings: Sentences that a reader must not miss, e.g. why a model was not retrained.
        results: Rows of the comparison, in order.
        paper: Average and best success rate by condition as the paper's Table VI has them; other
            simulator and observations, so for orientation only.
        comparisons: Paired tests, each condition against the reference.
        funnels: Milestones by condition.
        curves: Training runs.
        augmentations: Yield of each augmentation.
        datasets: Training data by condition.
        films: A success, a typical failure.
        lineage: The artifacts behind the results, parents in any order.
        costs: What each stage cost, in the order of the stages.
        next_steps: Commands worth typing.
    """

    title: str
    created: datetime
    facts: Mapping[str, str] = field(default_factory=dict)
    findings: tuple[str, ...] = ()
    results: tuple[ConditionResult, ...] = ()
    paper: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    comparisons: tuple[PairedComparison, ...] = ()
    funnels: tuple[Funnel, ...] = ()
    curves: tuple[TrainingCurve, ...] = ()
    augmentations: tuple[AugmentationYield, ...] = ()
    datasets: tuple[DatasetSize, ...] = ()
    films: tuple[FilmStrip, ...] = ()
    lineage: tuple[LineageNode, ...] = ()
    costs: tuple[StageCost, ...] = ()
    next_steps: tuple[NextStep, ...] = ()
