"""Annotations: which steps of which demonstrations are critical states, proposed or labelled by a human."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from juicer.annotation.labels import Label, find_recording
from juicer.annotation.propose import AnnotationConfig, critical_states, propose
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
        labels: What a human said. For a recording and critical state they name, nothing is proposed.
        num_workers: Threads, each with an environment of its own; one a processor if None.
        progress: Called for every demonstration.

    Yields:
        Annotations in the order of episodes, then of critical states.

    Raises:
        InvalidLabels: If a label names a recording, step or critical state that is not there, or two say the same.
    """
    if len(demonstrations) == 0:
        return
    task = demonstrations.records[0].task
    human = labelled(demonstrations, labels, len(critical_states(get_task(task), config)))

    def work(env: AssemblyEnv, index: int) -> list[Annotation]:
        return _annotate_one(env, demonstrations.read(index), config, human.get(index, []))

    with EnvironmentPool(task, num_workers) as pool:
        for index, annotations in enumerate(pool.map(work, range(len(demonstrations)))):
            progress(index + 1, len(demonstrations))
            yield from annotations


def labelled(
    demonstrations: DemonstrationReader, labels: Iterable[Label], num_critical_states: int
) -> dict[int, list[Annotation]]:
    """What labels say, by the number of the demonstration.

    Args:
        demonstrations: Episodes of one task.
        labels: What a human said, of steps of the recordings.
        num_critical_states: How many the task has.

    Raises:
        InvalidLabels: If a label names a recording, step or critical state that is not there, or two say the same.
    """
    by_episode: dict[int, list[Label]] = {}
    for label in labels:
        by_episode.setdefault(find_recording(label, demonstrations.records), []).append(label)
    return {
        index: _labelled(demonstrations.read(index), found, num_critical_states) for index, found in by_episode.items()
    }


def _annotate_one(
    env: AssemblyEnv, demonstration: Episode, config: AnnotationConfig, said: list[Annotation]
) -> list[Annotation]:
    known = {row.critical_state for row in said}
    rows = list(said)
    record = demonstration.record
    if record.outcome is Outcome.SUCCESS and len(known) < len(critical_states(env.task, config)):
        rows += [
            Annotation(record.episode_id, found.step, found.critical_state, "proposed", found.confidence)
            for found in propose(env, demonstration, config)
            if found.critical_state not in known
        ]
    return sorted(rows, key=lambda row: row.critical_state)


def _labelled(demonstration: Episode, labels: Sequence[Label], num_critical_states: int) -> list[Annotation]:
    """Labels of one demonstration, whose steps are those of the recording, as annotations of the episode's steps."""
    rows: dict[int, Annotation] = {}
    places: dict[int, str] = {}
    for label in labels:
        state = label.critical_state
        if state in rows:
            raise InvalidLabels(
                f"{label.where}: critical state {state} of recording {label.recording} was already labelled "
                f"at {places[state]}; keep one of the two"
            )
        if not 0 <= state < num_critical_states:
            raise InvalidLabels(
                f"{label.where}: there is no critical state {state}; "
                f"the task has {num_critical_states}, numbered from 0"
            )
        step = demonstration.step_of(label.step)
        if step is None:
            last = demonstration.recorded_step(len(demonstration) - 1)
            raise InvalidLabels(
                f"{label.where}: recording {label.recording} has no step {label.step} in which something was done; "
                f"the last one is {last}"
            )
        places[state] = label.where
        rows[state] = Annotation(demonstration.record.episode_id, step, state, "human", 1.0)
    return list(rows.values())
