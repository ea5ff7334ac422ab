"""What a report says, as plain data: the page knows no store, no orchestrator and no tracker.

Every part but the title may be left empty; the page then omits its section.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from juicer.evaluation import ConditionResult
from juicer.reporting.section import Section


@dataclass(frozen=True)
class Funnel:
    """How far the episodes of a condition got.

    Attributes:
        condition: Title of the condition, as in its :class:`~juicer.evaluation.ConditionResult`.
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
        label: What was trained, e.g. ``TA+CI, seed 0``.
        steps: Optimiser steps at which the losses were taken ``(K,)``.
        losses: Named curves ``(K,)`` over the steps, e.g. ``training`` and ``validation``; NaN where not measured.
        group: What it shares its colour with where runs are laid over each other, e.g. ``TA+CI``.
    """

    label: str
    steps: NDArray[np.integer]
    losses: Mapping[str, NDArray[np.floating]]
    group: str = ""


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
class EstimatorErrors:
    """How far an estimator is off where precision decides.

    Attributes:
        label: Which estimator, e.g. ``one_leg: front, gaze, wrist (4f3a09)``: task, views, id.
        by_critical_state: Mean errors by name of the critical state: millimetres and degrees.
    """

    label: str
    by_critical_state: Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class ShownAnalysis:
    """What else is known of a policy.

    Attributes:
        label: Which analysis of which model.
        sentence: What was done, and what came of it.
        columns: Head of the table of its numbers.
        rows: The table.
        png: The figure; empty if there is none.
        seconds: Wall time that it took, in this run or in an earlier one.
        cpu_seconds: CPU time of the same.
        apart: How far samples are from those drawn in the most steps, by the steps in which they were drawn [standard
            deviations]; as ``chance`` a second set in the most steps. Empty of other analyses.
    """

    label: str
    sentence: str
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    png: bytes = b""
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    apart: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class LineageNode:
    """An artifact.

    Attributes:
        id: ``kind/id``; unique.
        kind: One of :data:`~juicer.artifacts.ref.KINDS`.
        label: What it is, for people, e.g. ``50 demonstrations``.
        parents: Ids of the artifacts it was made from.
    """

    id: str
    kind: str
    label: str
    parents: tuple[str, ...] = ()


@dataclass(frozen=True)
class Moment:
    """A still of an episode.

    Attributes:
        image: ``(H, W, 3)`` uint8.
        step: Which step it shows.
        seconds: Simulated time since reset.
        video_seconds: Where it is in the video.
        label: What happens, e.g. a milestone's name.
    """

    image: NDArray[np.uint8]
    step: int
    seconds: float
    video_seconds: float
    label: str = ""


@dataclass(frozen=True)
class EpisodeVideo:
    """An episode to watch.

    Attributes:
        title: E.g. ``A success``.
        caption: Which policy and initial state, and what to see.
        mp4: The video, H.264.
        width: Its width [pixels].
        height: Its height [pixels].
        poster: What stands in its place until it is played ``(height, width, 3)`` uint8.
        moments: Stills in order of time.
    """

    title: str
    caption: str
    mp4: bytes
    width: int
    height: int
    poster: NDArray[np.uint8]
    moments: tuple[Moment, ...] = ()


@dataclass(frozen=True)
class EvaluatedEpisode:
    """A row of an evaluation.

    Attributes:
        number: Its number in the evaluation.
        initial_state: Seed of its initial state.
        outcome: How it ended.
        parts_assembled: Pairs assembled at its end.
        steps: Its length.
        milestones: Step at which each milestone was reached, by name; absent if never.
    """

    number: int
    initial_state: int
    outcome: str
    parts_assembled: int
    steps: int
    milestones: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class EvaluatedModel:
    """A trained model and every episode it was evaluated on.

    Attributes:
        condition: Title of the condition.
        seed: Root seed of its training.
        evaluation: Id of the evaluation.
        checkpoint: Id of the checkpoint.
        milestones: Names of the task's milestones, in order.
        episodes: All of them.
        lineage: The artifacts behind the evaluation and itself, parents in any order.
    """

    condition: str
    seed: int
    evaluation: str
    checkpoint: str
    milestones: tuple[str, ...]
    episodes: tuple[EvaluatedEpisode, ...]
    lineage: tuple[LineageNode, ...] = ()

    @property
    def label(self) -> str:
        """E.g. ``TA+CI, seed 0``."""
        return f"{self.condition}, seed {self.seed}"


@dataclass(frozen=True)
class Provenance:
    """What somebody needs to make these results again, and to look behind them.

    Attributes:
        facts: Commits, machines and versions, by name.
        configuration: The whole configuration as YAML; empty if it is not known.
        file_name: Under which name it is best saved.
        commands: To make the results again, in order.
        caveat: Why they may not come out the same; empty if there is no reason.
        links: Pages about the run, by name, as web addresses.
    """

    facts: Mapping[str, str] = field(default_factory=dict)
    configuration: str = ""
    file_name: str = "configuration.yaml"
    commands: tuple[str, ...] = ()
    caveat: str = ""
    links: Mapping[str, str] = field(default_factory=dict)


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
        paper: Average and best success rate by condition as the paper's Table VI has them, or the average alone as its
            Table VII has it; other simulator and observations, so for orientation only.
        sections: What the conditions say together: tests, curves, statements that hold or not, cost.
        funnels: Milestones by condition.
        curves: Training runs.
        augmentations: Yield of each augmentation.
        estimators: Errors of each estimator whose estimates a policy acts on.
        varied: PNGs of images as policies see them when they act, and as they were varied in training.
        analyses: What else is known of the policies.
        videos: A success, a typical failure.
        models: Every model with every episode of its evaluation.
        lineage: The artifacts behind the results, parents in any order.
        provenance: How to make the results again; none if it is not known.
        next_steps: Commands worth typing.
    """

    title: str
    created: datetime
    facts: Mapping[str, str] = field(default_factory=dict)
    findings: tuple[str, ...] = ()
    results: tuple[ConditionResult, ...] = ()
    paper: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    sections: tuple[Section, ...] = ()
    funnels: tuple[Funnel, ...] = ()
    curves: tuple[TrainingCurve, ...] = ()
    augmentations: tuple[AugmentationYield, ...] = ()
    estimators: tuple[EstimatorErrors, ...] = ()
    varied: tuple[bytes, ...] = ()
    analyses: tuple[ShownAnalysis, ...] = ()
    videos: tuple[EpisodeVideo, ...] = ()
    models: tuple[EvaluatedModel, ...] = ()
    lineage: tuple[LineageNode, ...] = ()
    provenance: Provenance | None = None
    next_steps: tuple[NextStep, ...] = ()
