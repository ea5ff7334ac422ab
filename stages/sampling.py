"""Many samples of an action at one state, drawn in few steps and in many (Fig. 4 of the paper)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from juicer.analysis.sampling import CHANCE, SLICED
from juicer.artifacts.manifest import FINDING, HEADLINE
from juicer.artifacts.ref import ArtifactRef
from juicer.config import Seed, StrictConfig
from juicer.episode import Episode
from juicer.renderers import renderer_facts
from juicer.seeding import stream
from juicer.storage.analyses import DIMENSIONS, write_samples
from juicer.storage.annotations import read_annotations
from juicer.storage.episodes import EpisodeReader
from juicer.tasks.registry import get_task
from juicer.tasks.specification import Insertion
from juicer.tasks.task_name import TaskName
from stages.runtime.context import StageContext
from stages.runtime.stage import stage

Steps = Annotated[int, Field(gt=0, le=1000)]


class SamplingSection(StrictConfig):
    """Where samples are drawn, how many, and in how many steps, whatever the task."""

    samples: int = Field(default=1000, ge=2, le=100_000, description="samples for each number of steps")
    inference_steps: tuple[Steps, ...] = Field(
        default=(1, 2, 4, 8, 100),
        min_length=1,
        max_length=20,
        description="steps in which they are drawn; the others are compared with the most",
    )
    critical_state: int | None = Field(
        default=None, ge=0, le=1000, description="index of the critical state; that of the first insertion if empty"
    )
    steps_before: int = Field(default=10, ge=0, le=100_000, description="steps before it")
    episode: int = Field(default=0, ge=0, le=10_000_000, description="which of the episodes that have it")
    action: Literal["first", "last"] = Field(
        default="first", description="whether the action that is executed first is shown, or the last of the chunk"
    )
    seed: Seed = Field(default=0, description="root of the noise")

    @field_validator("inference_steps")
    @classmethod
    def _are_distinct(cls, values: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(values)) < len(values):
            raise ValueError("each number may be there only once")
        return tuple(sorted(values))


class SamplingConfig(SamplingSection):
    """The same for a task."""

    task: TaskName = Field(description="assembly task")


@stage(
    kind="analysis",
    inputs={"checkpoint": "checkpoint", "episodes": "episodes", "annotations": "annotations"},
    libraries=("numpy", "scipy", "torch"),
)
def sampling(
    context: StageContext,
    *,
    checkpoint: ArtifactRef,
    episodes: ArtifactRef,
    annotations: ArtifactRef,
    config: SamplingConfig,
) -> None:
    """Draw many samples of an action shortly before a critical state, in few steps and in many."""
    from juicer.analysis.sampling import changes, distances
    from juicer.analysis.watching import sampling_policy, seen_at
    from juicer.policy.checkpoint import load_policy

    found = _state(context, episodes, annotations, config)
    if found is None:
        write_samples(context.draft.path, ())
        context.draft.summary |= {"samples": 0, FINDING: "no demonstration has the critical state, so nothing is drawn"}
        return
    episode, step = found
    folder = context.store.open(checkpoint, "checkpoint")
    drawn = []
    reference = config.inference_steps[-1]
    # The reference is drawn twice: how far apart two sets of the same distribution are tells what chance alone does.
    turns = [*((steps, 0) for steps in config.inference_steps), (reference, 1)]
    for done, (steps, turn) in enumerate(turns):
        context.progress(done, len(turns))
        policy = sampling_policy(load_policy(folder, config.task, device=context.machine.device, inference_steps=steps))
        seen = seen_at(policy, episode, [step])
        (chunks,) = policy.sample(seen, [stream(config.seed, "sampling", steps, turn)], config.samples)
        action = chunks[:, policy.obs_horizon - 1 if config.action == "first" else -1]
        drawn.append((steps, changes(action, episode.steps["proprioception"][step])))
    *samples, (_, again) = drawn
    write_samples(context.draft.path, samples)
    truth = samples[-1][1]
    compared = {**{str(steps): values for steps, values in samples[:-1]}, CHANCE: again}
    apart = {name: distances(values, truth, stream(config.seed, "directions")) for name, values in compared.items()}
    context.draft.summary |= {
        "samples": config.samples,
        "episode": episode.record.episode_id,
        "step": step,
        "reference_steps": reference,
        "distances": apart,
        "deviations": dict(zip(DIMENSIONS, truth.std(axis=0).tolist(), strict=True)),
        HEADLINE: _headline({name: each[SLICED] for name, each in apart.items()}, reference),
        **renderer_facts(context.store, checkpoint),
    }


def _headline(sliced: dict[str, float], reference: int) -> str:
    told = ", ".join(f"{name} {apart:.2f}" for name, apart in sliced.items())
    return f"distance to {reference} steps: {told}"


def _state(
    context: StageContext, episodes: ArtifactRef, annotations: ArtifactRef, config: SamplingConfig
) -> tuple[Episode, int] | None:
    """An episode and the step at which samples are drawn."""
    wanted = config.critical_state
    if wanted is None:
        states = get_task(config.task).critical_states
        wanted = next((index for index, state in enumerate(states) if isinstance(state, Insertion)), 0)
    rows = read_annotations(context.store.open(annotations, "annotations"))
    having = [row for row in rows if row.critical_state == wanted]
    if not having:
        return None
    row = having[min(config.episode, len(having) - 1)]
    reader = EpisodeReader(context.store.open(episodes, "episodes"))
    return reader.read(reader.find(row.episode_id)), max(row.step - config.steps_before, 0)
