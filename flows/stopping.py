"""Evaluation in blocks of initial states: after each it is looked whether all is settled, or more are needed.

Only whole blocks are looked at: no episode is left out because it took long. What is concluded holds however often one
looks, so a study may also be run in part, looked at, and continued later.
"""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import Field

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.errors import ConfigError
from juicer.evaluation import ConditionResult, anytime_interval, compare
from stages.evaluate import EvaluateConfig, EvaluateSection, evaluate
from stages.runtime.session import Session

LEVEL = 0.05
"""At most with this probability is a comparison ever decided between conditions that succeed equally often."""


class StopConfig(StrictConfig):
    """When the evaluation of a condition may end before all its episodes were run: when all of this is settled."""

    every: int = Field(
        default=25, gt=0, le=1_000_000, description="episodes of each model after which it is looked again"
    )
    width: float | None = Field(
        default=None,
        gt=0,
        lt=1,
        description="settled when the 95 % interval of the rate is at most so wide, over the episodes of all models",
    )
    comparison: bool = Field(
        default=True,
        description="settled when the comparison with the study's first condition is decided at the level of 5 %",
    )


class StoppableSection(EvaluateSection):
    """The final measurement, and when it may end early."""

    stop: StopConfig | None = Field(default=None, description="when it may end before all its episodes; never if empty")


def measure(
    session: Session,
    checkpoint: ArtifactRef,
    config: EvaluateConfig,
    stop: StopConfig | None,
    so_far: ArtifactRef | None = None,
) -> ArtifactRef:
    """Evaluate a model on all its episodes, or if it may stop, on those of one block more than so far."""
    if stop is None:
        return evaluate(session, checkpoint=checkpoint, config=config)
    episodes = stop.every + (num_episodes(session, so_far) if so_far else 0)
    so_many = config.model_copy(update={"episodes": min(episodes, config.episodes), "anytime": True})
    return evaluate(session, checkpoint=checkpoint, previous=so_far, config=so_many)


def measure_alone(
    session: Session, checkpoint: ArtifactRef, config: EvaluateConfig, stop: StopConfig | None
) -> ArtifactRef:
    """Evaluate a model that is compared with none: on all its episodes, or until its interval is narrow enough."""
    evaluation = measure(session, checkpoint, config, stop)
    while stop and stop.width is not None and num_episodes(session, evaluation) < config.episodes:
        found = session.store.manifest(evaluation).summary
        if found["interval_high"] - found["interval_low"] <= stop.width:
            break
        evaluation = measure(session, checkpoint, config, stop, evaluation)
    return evaluation


def num_episodes(session: Session, evaluation: ArtifactRef) -> int:
    """How many episodes an evaluation is of, also one that is not made yet."""
    return int(session.recipe(evaluation).config["episodes"])


def is_settled(result: ConditionResult, reference: ConditionResult | None, stop: StopConfig) -> bool:
    """Whether all is known of a condition that was to be known.

    Args:
        result: The condition so far.
        reference: What it is compared with, if with anything.
        stop: What is to be known.
    """
    if stop.width is not None:
        # More episodes narrow this interval, not the share of the other one that is due to how models differ.
        successes = sum(sum(model.successes) for model in result.models)
        low, high = anytime_interval(successes, result.num_episodes)
        if high - low > stop.width:
            return False
    if not stop.comparison or reference is None:
        return True
    try:
        return compare(reference, result).p_value <= LEVEL
    except ConfigError:
        return True  # other seeds or other initial states: there is nothing to pair


def unsettled(results: Sequence[ConditionResult], stop: StopConfig) -> list[str]:
    """Names of the conditions of which something is still to be found out, by further episodes of their own.

    Args:
        results: All conditions so far; the others are compared with the first.
        stop: What is to be known.
    """
    first, *others = results
    names = [result.condition for result in others if not is_settled(result, first, stop)]
    return names if is_settled(first, None, stop) else [first.condition, *names]


def told(results: Sequence[ConditionResult], stop: StopConfig) -> str:
    """How many episodes the models of each condition took, and why no more, for people."""
    open_ = unsettled(results, stop)
    numbers = [
        f"{result.title} {max(len(model.successes) for model in result.models)}"
        f"{' (not settled)' if result.condition in open_ else ''}"
        for result in results
    ]
    aims = []
    if stop.comparison and len(results) > 1:
        aims.append(f"the comparison with {results[0].title} is decided")
    if stop.width is not None:
        aims.append(f"the interval is at most {100 * stop.width:g} points wide")
    return f"{', '.join(numbers)}; looked after every {stop.every} whether {' and '.join(aims)}"
