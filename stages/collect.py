"""Rollouts of a trained policy, kept whole."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from pydantic import Field

from juicer.artifacts.ref import ArtifactRef
from juicer.episode import Episode, Outcome
from juicer.policy_rollout import RolloutConfig, RolloutSection, roll_out
from juicer.progress import Progress
from juicer.renderers import renderer_facts
from juicer.seed_ranges import Purpose, claim
from juicer.storage.episodes import write_episodes
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


class CollectSection(RolloutSection):
    """How many rollouts, and from where they start, whatever the task."""

    successes: int = Field(default=50, gt=0, le=10_000_000, description="rollouts end with this many successes")
    max_episodes: int = Field(default=200, gt=0, le=10_000_000, description="or after this many episodes")


class CollectConfig(RolloutConfig, CollectSection):
    """How many rollouts of a task, and from where they start."""


@stage(
    kind="episodes",
    inputs={"checkpoint": "checkpoint"},
    libraries=("mujoco", "numpy", "torch", "zarr"),
    noun="rollouts",
    counts="episodes",
    headline=("successes", "episodes", "steps"),
)
def collect(context: StageContext, *, checkpoint: ArtifactRef, config: CollectConfig) -> None:
    """Roll a policy out; every outcome is kept, with the simulator's full state."""
    episodes = roll_out(
        context.store.open(checkpoint, "checkpoint"),
        checkpoint.id,
        config,
        claim(Purpose.COLLECTION, config.first, config.max_episodes),
        num_envs=context.machine.num_envs,
        num_workers=context.machine.workers,
        device=context.machine.device,
        stop_after_successes=config.successes,
        progress=_towards(config.successes, config.max_episodes, context.progress),
    )
    tally = Counter[str]()
    write_episodes(context.draft.path, _counted(episodes, tally), {"source": "rollout", "policy": checkpoint.id})
    num_episodes = sum(tally[outcome] for outcome in Outcome)
    context.draft.summary |= {
        "episodes": num_episodes,
        "successes": tally[Outcome.SUCCESS],
        "success_rate": tally[Outcome.SUCCESS] / num_episodes,
        "steps": tally["steps"],
        "outcomes": {outcome.value: tally[outcome] for outcome in Outcome if tally[outcome]},
        **renderer_facts(context.store, checkpoint),
    }


def _towards(successes: int, max_episodes: int, listener: Progress) -> Progress:
    """Progress by whichever end is nearer: enough successes, or no initial states left."""

    def progress(done: int, total: int, **facts: float | str) -> None:
        share = max(float(facts["successes"]) / successes, done / max_episodes)
        listener(done, max(done, round(done / share)) if share else max_episodes, **facts)

    return progress


def _counted(episodes: Iterable[Episode], tally: Counter[str]) -> Iterator[Episode]:
    for episode in episodes:
        tally[episode.record.outcome] += 1
        tally["steps"] += len(episode)
        yield episode
