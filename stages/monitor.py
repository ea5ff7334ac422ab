"""Whether a policy that is about to fail is unsure beforehand: a failure monitor, and how good it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from statistics import median
from typing import TYPE_CHECKING

from pydantic import Field

from juicer.analysis.monitoring import MEASURES, Measure, Watched, Watcher, watched
from juicer.analysis.watching import sampling_policy, seen_at
from juicer.artifacts.manifest import FINDING, HEADLINE
from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.episode import Episode
from juicer.policy_rollout import RolloutConfig, roll_out
from juicer.renderers import renderer_facts
from juicer.seed_ranges import Purpose, claim
from juicer.seeding import stream
from juicer.storage.analyses import MonitorRow, write_monitor
from stages.runtime.context import StageContext
from stages.runtime.stage import stage

if TYPE_CHECKING:
    from juicer.policy.acting import TrainedPolicy


class MonitorSection(StrictConfig):
    """How a policy is watched, whatever the task."""

    episodes: int | None = Field(
        default=None, gt=0, le=1_000_000, description="rollouts that are watched; as many as are evaluated if empty"
    )
    watched_samples: int = Field(
        default=32, ge=2, le=10_000, description="samples at each prediction; they only watch, and change no rollout"
    )
    measure: Measure = Field(
        default="position_mm", description="what the headline and the alarms are of; the others are told beside it"
    )
    window: int = Field(default=5, gt=0, le=1000, description="predictions over which it is averaged")
    false_alarm_rate: float = Field(
        default=0.05, gt=0, lt=1, description="share of successful rollouts that may raise an alarm"
    )


class MonitorConfig(RolloutConfig, MonitorSection):
    """The same for a task, and where rollouts start: the same rollouts as in an evaluation that starts there."""

    episodes: int = Field(default=100, gt=0, le=1_000_000, description="rollouts that are watched")


@stage(
    kind="analysis",
    inputs={"checkpoint": "checkpoint"},
    libraries=("mujoco", "numpy", "torch"),
)
def monitor(context: StageContext, *, checkpoint: ArtifactRef, config: MonitorConfig) -> None:
    """Measure along rollouts how far samples of the policy spread, and whether that tells failures beforehand."""
    from juicer.policy.checkpoint import load_policy

    folder, machine = context.store.open(checkpoint, "checkpoint"), context.machine
    policy = sampling_policy(
        load_policy(folder, config.task, device=machine.device, inference_steps=config.inference_steps)
    )
    episodes = roll_out(
        folder,
        checkpoint.id,
        config,
        claim(Purpose.EVALUATION, config.first, config.episodes),
        num_envs=machine.num_envs,
        num_workers=machine.workers,
        device=machine.device,
        progress=context.progress,
    )
    rows = list(_watch(policy, episodes, config))
    write_monitor(context.draft.path, rows)
    found = {measure: watched(rows, measure, policy.action_horizon, config.window) for measure in MEASURES}
    facts = {"action_horizon": policy.action_horizon, **_facts(found, config)}
    renderers = renderer_facts(context.store, checkpoint)
    findings = [str(each[FINDING]) for each in (facts, renderers) if FINDING in each]
    context.draft.summary |= {**facts, **renderers, **({FINDING: "; ".join(findings)} if findings else {})}


def _watch(policy: TrainedPolicy, episodes: Iterable[Episode], config: MonitorConfig) -> Iterator[MonitorRow]:
    for number, episode in enumerate(episodes):
        steps = range(0, len(episode), policy.action_horizon)
        watcher, seed = Watcher(policy.action_horizon), episode.record.seed
        noise = [stream(config.seed, "monitor", seed, step) for step in steps]
        chunks = policy.sample(seen_at(policy, episode, steps), noise, config.watched_samples)
        for step, drawn in zip(steps, chunks, strict=True):
            yield MonitorRow(
                episode=number,
                seed=seed,
                step=step,
                outcome=episode.record.outcome.value,
                length=len(episode),
                **watcher.measure(drawn),
            )


def _facts(found: dict[Measure, Watched], config: MonitorConfig) -> dict[str, object]:
    """How well each measure tells failures, and what alarms by the chosen one come to."""
    chosen = found[config.measure]
    failures = int(chosen.failed.sum())
    facts: dict[str, object] = {"episodes": config.episodes, "failures": failures, "measure": config.measure}
    place = chosen.before_any_success
    separation = None if place is None else chosen.separation(place)
    if place is None or separation is None:
        return {**facts, FINDING: f"{chosen.why_not_compared()}, so a monitor has nothing to tell apart"}
    low, high = separation.interval(stream(config.seed, "bootstrap"))
    alarms = chosen.alarms(config.false_alarm_rate)
    lead = median(alarms.leads) if alarms.leads else None
    each = {measure: one.separation(place) for measure, one in found.items()}
    told = f", {alarms.found:.0%} of failures found" + ("" if lead is None else f", {lead:.0f} steps early")
    return {
        **facts,
        "step": place * chosen.stride,
        "auc": separation.auc,
        "auc_low": low,
        "auc_high": high,
        "auc_by_measure": {measure: one.auc for measure, one in each.items() if one},
        "false_alarms": alarms.false_alarms,
        "found": alarms.found,
        "lead_steps": lead,
        HEADLINE: f"AUC {separation.auc:.2f} ({low:.2f} to {high:.2f}) at step {place * chosen.stride}{told}",
    }
