"""Commands that make something outside a flow: an evaluation, a repaired artifact."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from flows.running.context import open_run
from flows.running.data_folder import open_store, prepare_folder
from flows.running.device import check_device
from flows.running.repair import Repaired, repair
from flows.running.settings import read_settings
from flows.terminal.output import say, say_json
from juicer.artifacts.manifest import FINDING, LABEL
from juicer.config import parse_config
from juicer.errors import ConfigError, InvalidCheckpoint
from juicer.shifts import parse_shift
from juicer.tasks.registry import get_task

if TYPE_CHECKING:
    from juicer.artifacts.ref import ArtifactRef
    from juicer.artifacts.store import ArtifactStore
    from stages.runtime.session import Session


def evaluate_checkpoint(text: str, asked: Mapping[str, object], until_width: float | None, as_json: bool) -> None:
    """``juicer evaluate``.

    Args:
        text: Id of a checkpoint, or its first letters.
        asked: What :class:`stages.evaluate.EvaluateConfig` says; without a task, that of the checkpoint is taken.
        until_width: Width of the interval at which it ends, if it does before all episodes.
        as_json: Whether it is told to a machine.
    """
    from flows.stopping import StopConfig, measure_alone
    from stages.evaluate import EvaluateConfig

    stop = None
    if until_width is not None:
        stop = parse_config({"width": until_width, "comparison": False}, StopConfig, origin="evaluate --until-width")
    with run_on(text, "checkpoint") as (session, ref):
        store = session.store
        task = asked["task"] or only_task(store, ref)
        content = {**asked, "task": task, "shift": parse_shift(asked["shift"])}
        config = parse_config(content, EvaluateConfig, origin="evaluate")
        evaluation = measure_alone(replace(session, label=ref.id), ref, config, stop)
    summary = store.manifest(evaluation).summary
    if as_json:
        say_json({"evaluation": str(evaluation), **summary})
        return
    low, high = summary["interval_low"], summary["interval_high"]
    say(f"success {summary[LABEL]} (95 % interval {low:.0%} to {high:.0%}); {evaluation}")
    if FINDING in summary:
        say(f"  {summary[FINDING]}")
    for name in get_task(config.task).milestones:
        say(f"  {name.replace('_', ' '):16} {summary['milestones'][name]}")


@contextmanager
def run_on(text: str, kind: str | None = None) -> Iterator[tuple[Session, ArtifactRef]]:
    """A run that is not recorded, about an artifact of which the first letters of its id are given.

    Raises:
        ArtifactNotFound: If none or several answer to the text.
        ConfigError: If this machine does not have the device that is set.
    """
    settings = read_settings()
    check_device(settings)
    prepare_folder(settings)
    ref = open_store(settings).resolve(text, kind)
    with open_run(settings, None) as run_context:
        yield run_context.session, ref


def only_task(store: ArtifactStore, checkpoint: ArtifactRef) -> str:
    """The task that a checkpoint was trained for.

    Raises:
        InvalidCheckpoint: If it does not say.
        ConfigError: If it was trained for several.
    """
    tasks = store.manifest(checkpoint).summary.get("tasks")
    if not isinstance(tasks, list) or not tasks:
        raise InvalidCheckpoint(f"{checkpoint} does not say what it was trained for; choose a task with --task")
    if len(tasks) > 1:
        raise ConfigError(f"{checkpoint} was trained for {', '.join(tasks)}; choose one with --task")
    return str(tasks[0])


def repair_artifact(text: str, files: Path | None, as_json: bool) -> None:
    """``juicer repair``."""
    repaired = []
    with run_on(text) as (session, ref):
        for each in repair(session, ref, files):
            repaired.append(each)
            # At once: where things are now is to be known also if a later repair fails.
            _say_repaired(each, to_stderr=as_json)
    if as_json:
        aside = {str(each.ref): each.aside for each in repaired if each.aside}
        say_json({"repaired": [str(each.ref) for each in repaired], "aside": aside})
    elif not repaired:
        say(f"{ref} is whole; nothing to repair")


def _say_repaired(each: Repaired, *, to_stderr: bool) -> None:
    done = f"recomputed {each.ref}" if each.recomputed else f"restored {each.ref} without computing anything"
    typer.echo(done, err=to_stderr)
    if each.aside:
        kept = f"  what was there before is kept in {each.aside}; delete it when you need it no more"
        typer.echo(kept, err=to_stderr)
