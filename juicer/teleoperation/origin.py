"""The step of a rollout from which an operator goes on by hand, to finish what a policy did not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juicer.episode import Episode, EpisodeRecord, Outcome, Source
from juicer.errors import EvaluationOnly, NotCorrectable
from juicer.seed_ranges import SEED_RANGES, Purpose
from juicer.shifts import require_unshifted


@dataclass(frozen=True)
class Origin:
    """Where a correction begins.

    Attributes:
        parent: Id of the rollout that is corrected.
        step: Step of it from which the operator goes on.
        seed: Initial-state seed of the rollout.
        state: Simulator state before that step.
        actions: What the policy did before that step ``(step, 10)``: it leads from the reset to the state.
    """

    parent: str
    step: int
    seed: int
    state: NDArray[np.float64]
    actions: NDArray[np.float32]


def require_correctable(record: EpisodeRecord) -> None:
    """Refuse an episode that no correction may be grown from.

    Raises:
        NotCorrectable: If it is not a rollout.
        EvaluationOnly: If it is of an evaluation, or was made under a shift.
    """
    if record.source is not Source.ROLLOUT:
        raise NotCorrectable(
            f"episode {record.episode_id} is not a rollout of a policy (its source is {record.source}); "
            "only rollouts are finished by hand"
        )
    if record.seed not in SEED_RANGES[Purpose.COLLECTION]:
        raise EvaluationOnly(
            f"rollout {record.episode_id} was not collected to be learned from: its seed {record.seed} is not one of "
            "those for collection; only rollouts that a run has collected are finished by hand"
        )
    require_unshifted([record], f"rollout {record.episode_id}")


def origin_of(episode: Episode, step: int) -> Origin:
    """A step of a rollout as the beginning of a correction.

    Args:
        episode: The rollout.
        step: Its step; its length stands for the end.

    Raises:
        NotCorrectable: If it is not a rollout, or has ended at that step.
        EvaluationOnly: If it is of an evaluation, or was made under a shift.
        StateMissing: If it has no simulator states, or no such step.
    """
    record = episode.record
    require_correctable(record)
    if step == len(episode) and record.outcome is not Outcome.TIMEOUT:
        raise NotCorrectable(
            f"rollout {record.episode_id} has ended at step {step} ({record.outcome}); choose an earlier step"
        )
    actions = np.asarray(episode.steps["action"][:step], np.float32)
    return Origin(record.episode_id, step, record.seed, episode.state(step), actions)
