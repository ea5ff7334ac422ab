"""What acting on the densest of many samples is worth, and what it costs."""

from __future__ import annotations

import time

import numpy as np
from pydantic import Field

from juicer.artifacts.manifest import HEADLINE
from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.episode import Outcome
from juicer.errors import ConfigError
from juicer.evaluation import mcnemar_p_value, wilson_interval
from juicer.seeding import stream
from juicer.storage.analyses import ModesRow, write_modes
from juicer.storage.episodes import EpisodeReader
from juicer.storage.evaluations import EXAMPLES, EvaluationRow, read_evaluation
from juicer.tasks.task_name import TaskName
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


class ModesConfig(StrictConfig):
    """How the cost is measured."""

    task: TaskName = Field(description="assembly task")
    predictions: int = Field(default=10, gt=0, le=10_000, description="predictions whose cost is measured")


@stage(
    kind="analysis",
    inputs={"checkpoint": "checkpoint", "evaluations": "evaluation"},
    libraries=("numpy", "torch"),
)
def modes(
    context: StageContext, *, checkpoint: ArtifactRef, evaluations: tuple[ArtifactRef, ...], config: ModesConfig
) -> None:
    """Compare evaluations of one policy that differ in how many samples it chooses among."""
    tables = {}
    for ref in evaluations:
        samples = int(context.store.manifest(ref).recipe.config.get("samples", 1))
        if samples in tables:
            raise ConfigError(f"two of the evaluations are of {samples} samples; compare one of each")
        tables[samples] = read_evaluation(context.store.open(ref, "evaluation"))
    first = next(iter(tables.values()))
    rows = []
    for done, (samples, table) in enumerate(tables.items()):
        context.progress(done, len(tables))
        rows.append(_row(samples, table, first, _chunk_ms(context, checkpoint, evaluations[0], samples, config)))
    write_modes(context.draft.path, rows)
    context.draft.summary |= {
        "episodes": rows[0].episodes,
        "success_rate": {str(row.samples): row.successes / row.episodes for row in rows},
        "chunk_ms": {str(row.samples): row.chunk_ms for row in rows},
        HEADLINE: "; ".join(
            f"{row.samples}: {row.successes / row.episodes:.0%}, {row.chunk_ms:.3g} ms" for row in rows
        ),
    }


def _row(samples: int, table: list[EvaluationRow], first: list[EvaluationRow], chunk_ms: float) -> ModesRow:
    """Success, paired with that of the first on the initial states that both began in."""
    won = {row.seed: row.outcome is Outcome.SUCCESS for row in table}
    before = {row.seed: row.outcome is Outcome.SUCCESS for row in first if row.seed in won}
    lost = sum(succeeded and not won[seed] for seed, succeeded in before.items())
    gained = sum(won[seed] and not succeeded for seed, succeeded in before.items())
    successes = sum(won.values())
    low, high = wilson_interval(successes, len(table))
    return ModesRow(samples, len(table), successes, low, high, mcnemar_p_value(lost, gained), chunk_ms)


def _chunk_ms(
    context: StageContext, checkpoint: ArtifactRef, evaluation: ArtifactRef, samples: int, config: ModesConfig
) -> float:
    """Milliseconds that one core of this machine needs for a chunk: the median over predictions of an episode."""
    from juicer.analysis.watching import sampling_policy, seen_at
    from juicer.policy.checkpoint import load_policy

    policy = sampling_policy(load_policy(context.store.open(checkpoint, "checkpoint"), config.task, samples=samples))
    episode = EpisodeReader(context.store.open(evaluation, "evaluation") / EXAMPLES).read(0)
    steps = np.linspace(0, len(episode) - 1, config.predictions + 1).astype(int)
    seen = seen_at(policy, episode, steps)
    noise = [stream(0, "cost")]
    taken = []
    for place in range(len(steps)):
        one = {name: values[place : place + 1] for name, values in seen.items()}
        began = time.process_time()
        policy.predict(one, noise)
        taken.append(1000 * (time.process_time() - began))
    return float(np.median(taken[1:]))  # the first one prepares what the others find
