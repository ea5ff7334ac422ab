"""Commands that make something outside a flow: an evaluation, a repaired artifact."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from flows.commands.output import say, say_json
from flows.opening import opened
from flows.repair import repair
from flows.settings import read_settings
from flows.store import open_store
from juicer.config import parse_config
from juicer.errors import ConfigError
from juicer.tasks.registry import get_task

if TYPE_CHECKING:
    from juicer.artifacts.ref import ArtifactRef
    from juicer.artifacts.store import ArtifactStore


def evaluate_checkpoint(
    text: str, task: str | None, episodes: int, seed_start: int, randomness: str, as_json: bool
) -> None:
    """``juicer evaluate``."""
    from stages.evaluate import EvaluateConfig, evaluate

    settings = read_settings()
    ref = open_store(settings).resolve(text, "checkpoint")
    with opened(settings, None) as surroundings:
        store = surroundings.session.store
        task = task or _only_task(store, ref)
        content = {"task": task, "episodes": episodes, "first": seed_start, "randomness": randomness}
        config = parse_config(content, EvaluateConfig, origin="evaluate")
        session = replace(surroundings.session, label=ref.id)
        evaluation = evaluate(session, checkpoint=ref, config=config)
    summary = store.manifest(evaluation).summary
    if as_json:
        say_json({"evaluation": str(evaluation), **summary})
        return
    low, high = summary["interval_low"], summary["interval_high"]
    say(
        f"{summary['success_rate']:.0%} of {summary['episodes']} episodes succeed "
        f"(95 % interval {low:.0%} to {high:.0%}); {evaluation}"
    )
    for name in get_task(task).milestones:
        say(f"  {name.replace('_', ' '):16} {summary['milestones'][name]}")


def _only_task(store: ArtifactStore, checkpoint: ArtifactRef) -> str:
    tasks = store.manifest(checkpoint).summary["tasks"]
    if len(tasks) > 1:
        raise ConfigError(f"{checkpoint} was trained for {', '.join(tasks)}; choose one with --task")
    return str(tasks[0])


def repair_artifact(text: str, files: Path | None, as_json: bool) -> None:
    """``juicer repair``."""
    settings = read_settings()
    ref = open_store(settings).resolve(text)
    with opened(settings, None) as surroundings:
        repaired = [str(each) for each in repair(surroundings.session, ref, files)]
    if as_json:
        say_json({"repaired": repaired})
    else:
        say(f"recomputed {', '.join(repaired)}" if repaired else f"{ref} is whole; nothing to repair")
