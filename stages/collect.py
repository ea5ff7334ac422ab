"""Rollouts of a trained policy, kept whole."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from pydantic import Field

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.episode import Episode, Outcome
from juicer.evaluation import Purpose, claim
from juicer.progress import Progress
from juicer.rollout import rollout
from juicer.storage.episodes import write_episodes
from juicer.tasks.specification import Randomness
from stages.stage import StageContext, stage


class CollectConfig(StrictConfig):
    """How many rollouts, and from where they start."""

    task: str = Field(default="one_leg", description="assembly task")
    randomness: Randomness = Field(default=Randomness.LOW, description="level of the initial states")
    successes: int = Field(default=50, gt=0, description="rollouts end with this many successes")
    max_episodes: int = Field(default=200, gt=0, description="or after this many episodes")
    first: int = Field(default=0, ge=0, description="position of the first initial state among those for collection")
    max_steps: int | None = Field(default=None, gt=0, description="steps an episode; the task's own limit if empty")
    seed: int = Field(default=0, ge=0, description="root of the policy's noise")


@stage(kind="episodes", inputs={"checkpoint": "checkpoint"}, libraries=("mujoco", "numpy", "torch", "zarr"))
def collect(context: StageContext, *, checkpoint: ArtifactRef, config: CollectConfig) -> None:
    """Roll a policy out; every outcome is kept, with the simulator's full state."""
    from juicer.policy.checkpoint import load_policy  # torch takes seconds to import

    episodes = rollout(
        load_policy(context.store.open(checkpoint, "checkpoint")),
        config.task,
        config.randomness,
        claim(Purpose.COLLECTION, config.first, config.max_episodes),
        num_envs=context.num_envs,
        max_steps=config.max_steps,
        policy_id=checkpoint.id,
        root_seed=config.seed,
        stop_after_successes=config.successes,
        num_workers=context.workers,
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
    }


def _towards(successes: int, max_episodes: int, listener: Progress) -> Progress:
    """Progress by whichever end is nearer: enough successes, or no initial states left."""

    def progress(done: int, total: int, **facts: float | str) -> None:
        share = max(float(facts["successes"]) / successes, done / max_episodes)
        listener(done, max(done, round(done / share)), **facts)

    return progress


def _counted(episodes: Iterable[Episode], tally: Counter[str]) -> Iterator[Episode]:
    for episode in episodes:
        tally[episode.record.outcome] += 1
        tally["steps"] += len(episode)
        yield episode
