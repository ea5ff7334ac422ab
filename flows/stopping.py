"""Evaluation in blocks of initial states: after each it is looked whether all is settled, or more are needed.

Only whole blocks are looked at: no episode is left out because it took long. What is concluded holds however often one
looks, so a study may also be run in part, looked at, and continued later.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.evaluation import ConditionResult, anytime_interval
from juicer.study.statistics import Difference, differences
from stages.evaluate import EvaluateConfig, EvaluateSection, evaluate
from stages.runtime.session import Session

if TYPE_CHECKING:
    from juicer.study.material import TaskStudy


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
        description="settled when its comparisons are decided by the tests of the report: all pairs of conditions that "
        "differ in their method alone, adjusted for their number, at the level of 5 %",
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
    episodes = min(stop.every + (num_episodes(session, so_far) if so_far else 0), config.episodes)
    so_many = config.model_copy(update={"episodes": episodes, "anytime": True})
    # Each block has a name of its own, by which it is known what is to come.
    block = session.for_model(f"{session.label} to {episodes} episodes".strip(), session.record)
    return evaluate(block, checkpoint=checkpoint, previous=so_far, config=so_many)


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


def open_conditions(study: TaskStudy, stop: StopConfig) -> dict[str, str]:
    """Conditions whose evaluation goes on, and why: what the report would say of them is not settled yet.

    The comparisons are those of the report, with p-values adjusted for their number as there: all pairs of conditions
    that differ in their method alone and see the same. What is compared with none is evaluated to the end, unless a
    width is asked for.

    Args:
        study: All conditions so far.
        stop: What is to be known.
    """
    groups = (results for _, results in study.tested_together) if stop.comparison else ()
    tests = [test for results in groups for test in differences(results, study.untrained)]
    compared = {name for test in tests for name in _names(test)}
    undecided = {name for test in tests if not test.is_significant for name in _names(test)}
    found = {}
    for name, measured in study.measured.items():
        if name in undecided or (stop.width is not None and _width(measured.result) > stop.width):
            found[name] = "not settled"
        elif name not in compared and stop.width is None:
            found[name] = "compared with none"
    return found


def _names(test: Difference) -> tuple[str, str]:
    return test.first.condition, test.second.condition


def _width(result: ConditionResult) -> float:
    # More episodes narrow this interval, not the share of the other one that is due to how models differ.
    low, high = anytime_interval(sum(sum(model.successes) for model in result.models), result.num_episodes)
    return high - low


def episodes_in_words(study: TaskStudy, stop: StopConfig) -> str:
    """How many episodes the models of each condition took, and why no more, for people."""
    reasons = open_conditions(study, stop)
    numbers = [
        f"{measured.result.title} {max(len(model.successes) for model in measured.result.models)}"
        f"{f' ({reasons[name]})' if name in reasons else ''}"
        for name, measured in study.measured.items()
    ]
    aims = ["all comparisons are decided"] if stop.comparison else []
    aims += [f"the interval is at most {100 * stop.width:g} points wide"] if stop.width is not None else []
    return f"{', '.join(numbers)}; looked after every {stop.every} whether {' and '.join(aims)}"
