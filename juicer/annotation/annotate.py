"""Annotations: which steps of which demonstrations are critical states, proposed or labelled by a human."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from juicer.annotation.labels import Label
from juicer.annotation.propose import AnnotationConfig, propose
from juicer.episode import DemonstrationReader, Episode, Outcome
from juicer.errors import InvalidLabels
from juicer.progress import Progress, silent_progress
from juicer.sim.env import AssemblyEnv
from juicer.sim.pool import EnvironmentPool
from juicer.storage.annotations import Annotation
from juicer.tasks.registry import get_task


def annotate(
    demonstrations: DemonstrationReader,
    config: AnnotationConfig,
    labels: Iterable[Label] = (),
    *,
    num_workers: int | None = None,
    progress: Progress = silent_progress,
) -> Iterator[Annotation]:
    """Annotate every successful demonstration; a human's labels replace the proposals.

    Args:
        demonstrations: Episodes of one task.
        config: How to propose.
        labels: What a human said. For an episode and critical state they name, nothing is proposed.
        num_workers: Threads, each with an environment of its own; one a processor if None.
        progress: Told of every demonstration.

    Yields:
        Annotations in the order of episodes, then of critical states.

    Raises:
        InvalidLabels: If a label names an episode, step or critical state that is not there.
    """
    if len(demonstrations) == 0:
        return
    task = demonstrations.read(0).record.task
    by_episode: dict[int, list[Label]] = {}
    for label in labels:
        _check_label(label, demonstrations, get_task(task).num_critical_states)
        by_episode.setdefault(label.episode, []).append(label)

    def work(env: AssemblyEnv, index: int) -> list[Annotation]:
        return _annotate_one(env, index, demonstrations.read(index), config, by_episode.get(index, []))

    with EnvironmentPool(task, num_workers) as pool:
        for index, annotations in enumerate(pool.map(work, range(len(demonstrations)))):
            progress(index + 1, len(demonstrations))
            yield from annotations


def _annotate_one(
    env: AssemblyEnv, index: int, demonstration: Episode, config: AnnotationConfig, labels: list[Label]
) -> list[Annotation]:
    labelled = {label.critical_state for label in labels}
    rows = [Annotation(index, label.step, label.critical_state, "human", 1.0) for label in labels]
    if demonstration.record.outcome is Outcome.SUCCESS and len(labelled) < env.task.num_critical_states:
        rows += [
            Annotation(index, proposal.step, proposal.critical_state, "proposed", proposal.confidence)
            for proposal in propose(env, demonstration, config)
            if proposal.critical_state not in labelled
        ]
    return sorted(rows, key=lambda row: row.critical_state)


def _check_label(label: Label, demonstrations: DemonstrationReader, num_critical_states: int) -> None:
    if not 0 <= label.episode < len(demonstrations):
        raise InvalidLabels(
            f"{label.where}: there is no episode {label.episode}; episodes are numbered 0 to {len(demonstrations) - 1}"
        )
    length = len(demonstrations.read(label.episode))
    if not 0 <= label.step < length:
        raise InvalidLabels(f"{label.where}: episode {label.episode} has no step {label.step}; it has {length} steps")
    if not 0 <= label.critical_state < num_critical_states:
        raise InvalidLabels(
            f"{label.where}: there is no critical state {label.critical_state}; "
            f"the task has {num_critical_states}, numbered from 0"
        )
