"""The loop: draw, depart, return, verify, until there are enough snippets of every critical state.

Attempt ``k`` depends on ``stream(seed, "augment", k)`` and on what there was at the start of its block alone: the
balance and, if departures are placed by coverage, the offsets that had been visited.
Blocks have a fixed size and are judged in the order of attempts, so threads change nothing but the time taken.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count, groupby

import numpy as np
from numpy.typing import NDArray

from juicer.augmentation.config import AugmentationConfig, CoveragePlacement
from juicer.augmentation.coverage import Coverage, coverages
from juicer.augmentation.execute import execute, reproduces
from juicer.augmentation.plan import POSE_SIZE, draw_kind, plan_departure
from juicer.augmentation.reference import Reference, reference_of
from juicer.augmentation.regrasp import regrasp
from juicer.augmentation.verify import RejectionReason, deviation_from_reference
from juicer.episode import DemonstrationReader, Episode, Outcome
from juicer.errors import ArtifactError
from juicer.geometry import rot6d_to_matrix, rotation_angle
from juicer.progress import Progress, silent_progress
from juicer.seeding import stream
from juicer.sim.env import AssemblyEnv
from juicer.sim.pool import EnvironmentPool
from juicer.storage.annotations import Annotation
from juicer.text import printable

BLOCK_SIZE = 16
"""Attempts between two looks at the balance. Part of what a seed means: another size gives other snippets."""

_NO_STEP_LIMIT = 10**9


@dataclass(frozen=True)
class Snippet:
    """A corrective episode that passed every check.

    Attributes:
        episode: Return and arrival, as it goes into storage.
        reference: What it returns to, held as it was in this attempt.
        departure: Kind of departure it returns from.
    """

    episode: Episode
    reference: Reference
    departure: str

    @property
    def critical_state(self) -> int:
        """Index of the critical state it returns to."""
        return self.reference.critical_state

    @property
    def way_back(self) -> NDArray[np.float64]:
        """End-effector poses ``(N, 9)`` before it joins the demonstration's actions."""
        way = len(self.episode) - len(self.reference.actions)
        return np.asarray(self.episode.steps["proprioception"][:way, :POSE_SIZE], dtype=np.float64)

    @property
    def start(self) -> tuple[float, float, float]:
        """Where it begins as seen from the critical pose: metres aside and above, and the angle turned in radians."""
        first = np.asarray(self.episode.steps["proprioception"][0][:POSE_SIZE], dtype=np.float64)
        critical = self.reference.pose
        offset = first[:3] - critical[:3]
        turned = rotation_angle(rot6d_to_matrix(critical[3:]), rot6d_to_matrix(first[3:]))
        return float(np.linalg.norm(offset[:2])), float(offset[2]), float(turned)


@dataclass(frozen=True)
class FailedAttempt:
    """An attempt that gave no snippet.

    Attributes:
        parent: Id of the demonstration it started from.
        critical_state: Critical state it departed from.
        departure: Kind of departure.
        reason: What was wrong.
    """

    parent: str
    critical_state: int
    departure: str
    reason: RejectionReason


def augment(
    demonstrations: DemonstrationReader,
    annotations: Iterable[Annotation],
    config: AugmentationConfig,
    *,
    seed: int,
    rollouts: Sequence[DemonstrationReader] = (),
    num_workers: int | None = None,
    progress: Progress = silent_progress,
) -> Iterator[Snippet | FailedAttempt]:
    """Grow demonstrations around their critical states, and yield every attempt in order.

    Critical states are drawn with a probability proportional to one over the number of their snippets so far
    (which starts at one), the demonstration uniformly. Ends with the snippet that completes
    ``config.num_snippets``, or after ``config.max_attempts_per_snippet`` times as many attempts.

    Args:
        demonstrations: Annotated episodes; those that are no success, are not used.
        annotations: Their critical states.
        config: What to make.
        seed: Root of all draws.
        rollouts: Where policies went and failed; looked at if departures are placed by coverage.
        num_workers: Threads, each with an environment of its own; one a processor if None.
        progress: Called after every attempt: snippets so far of those wanted.

    Yields:
        What became of each attempt; nothing if no critical state of a successful demonstration is trusted.
    """
    references = find_references(demonstrations, annotations, config)
    if not references:
        return
    kept = 0
    for made, attempt in enumerate(_attempts(references, config, seed, rollouts, num_workers), start=1):
        kept += isinstance(attempt, Snippet)
        progress(kept, config.num_snippets, attempts=made)
        yield attempt
        if kept == config.num_snippets:
            return


def find_references(
    demonstrations: DemonstrationReader, annotations: Iterable[Annotation], config: AugmentationConfig
) -> list[Reference]:
    """References of all trusted critical states of successful demonstrations, in the annotations' order.

    Raises:
        ArtifactError: If the annotations are of other episodes.
    """
    numbers = {record.episode_id: number for number, record in enumerate(demonstrations.records)}
    trusted = [annotation for annotation in annotations if annotation.confidence >= config.min_confidence]
    references = []
    for episode_id, group in groupby(trusted, key=lambda annotation: annotation.episode_id):
        if (number := numbers.get(episode_id)) is None:
            raise ArtifactError(f"no demonstration is the annotated episode {printable(episode_id)}; annotate these")
        if demonstrations.records[number].outcome is not Outcome.SUCCESS:
            continue
        demonstration = demonstrations.read(number)
        references += [
            reference_of(
                demonstration,
                step=annotation.step,
                critical_state=annotation.critical_state,
                steps_after_gripper_change=config.steps_after_gripper_change,
            )
            for annotation in group
        ]
    return references


def _attempts(
    references: Sequence[Reference],
    config: AugmentationConfig,
    seed: int,
    rollouts: Sequence[DemonstrationReader],
    num_workers: int | None,
) -> Iterator[Snippet | FailedAttempt]:
    by_state: dict[int, list[Reference]] = {}
    for reference in references:
        by_state.setdefault(reference.critical_state, []).append(reference)
    counts = dict.fromkeys(sorted(by_state), 1)
    placement = config.placement
    coverage = coverages(by_state, placement, rollouts) if isinstance(placement, CoveragePlacement) else {}

    def work(env: AssemblyEnv, index: int) -> Snippet | FailedAttempt:
        rng = stream(seed, "augment", index)
        reference = _draw_reference(by_state, counts, rng)
        return attempt_snippet(env, reference, config, rng, coverage.get(reference.critical_state))

    limit = config.num_snippets * config.max_attempts_per_snippet
    found: set[str] = set()
    with EnvironmentPool(references[0].task, num_workers, max_steps=_NO_STEP_LIMIT) as pool:
        for start in range(0, limit, BLOCK_SIZE):
            kept: dict[int, list[Snippet]] = {state: [] for state in counts}
            for attempt in pool.map(work, range(start, min(start + BLOCK_SIZE, limit))):
                if isinstance(attempt, Snippet):
                    attempt = _unless_repeated(attempt, found)
                if isinstance(attempt, Snippet):
                    kept[attempt.critical_state].append(attempt)
                yield attempt
            # Only now: attempts of a block must not see each other's results.
            for state, snippets in kept.items():
                counts[state] += len(snippets)
                if state in coverage:
                    coverage[state].visit((snippet.way_back, snippet.reference.pose) for snippet in snippets)


def _unless_repeated(snippet: Snippet, found: set[str]) -> Snippet | FailedAttempt:
    """Ranges of a single point give the same snippet again and again, which counts once."""
    record = snippet.episode.record
    if record.episode_id in found:
        return FailedAttempt(str(record.parent), snippet.critical_state, snippet.departure, RejectionReason.REPEATED)
    found.add(record.episode_id)
    return snippet


def _draw_reference(
    by_state: dict[int, list[Reference]], counts: dict[int, int], rng: np.random.Generator
) -> Reference:
    states = list(counts)
    weights = np.array([1.0 / counts[state] for state in states])
    chosen = by_state[states[rng.choice(len(states), p=weights / weights.sum())]]
    return chosen[rng.integers(len(chosen))]


def attempt_snippet(
    env: AssemblyEnv,
    reference: Reference,
    config: AugmentationConfig,
    rng: np.random.Generator,
    coverage: Coverage | None = None,
) -> Snippet | FailedAttempt:
    """Plan, execute and verify one snippet.

    Args:
        env: Environment of the reference's task without a step limit; its state is replaced.
        reference: Critical state to return to.
        config: Ranges and tolerances.
        rng: Source of the draws.
        coverage: What has been visited around the critical state; the first departure drawn is made without.
    """
    kind = draw_kind(config.departures, rng)
    if config.grasp is not None:
        regrasped = regrasp(env, reference, config.grasp, rng)
        if isinstance(regrasped, RejectionReason):
            return FailedAttempt(reference.parent, reference.critical_state, kind, regrasped)
        reference = regrasped
    drawn = (plan_departure(reference.pose, config.departures[kind], rng) for _ in count())
    departure = next(drawn) if coverage is None else coverage.choose(drawn, reference)
    result = execute(env, reference, departure)
    if isinstance(result, Episode):
        reason = deviation_from_reference(result, reference, config)
        if reason is None and not reproduces(env, result):
            reason = RejectionReason.NOT_REPRODUCED
        if reason is None:
            return Snippet(result, reference, kind)
        result = reason
    return FailedAttempt(reference.parent, reference.critical_state, kind, result)
