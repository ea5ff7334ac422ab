"""Commands that run flows, or tell what they would do."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from flows.commands.output import say, say_json, say_table
from flows.conditions import Condition
from flows.environment import API_VARIABLE, prepare_environment
from flows.settings import Settings, read_settings
from flows.store import open_store
from flows.temporary_server import TemporaryServer
from juicer.errors import ConfigError, ServiceUnavailable, did_you_mean
from stages.isolation import warm_up

if TYPE_CHECKING:
    from flows.config import RunConfig
    from flows.execution import RunOutcome
    from juicer.artifacts.store import ArtifactStore


@dataclass(frozen=True)
class Part:
    """Which part of a configuration is meant; all of it where nothing is said.

    Attributes:
        task: One of its tasks.
        condition: One of its conditions.
        seed: One of its seeds.
    """

    task: str | None = None
    condition: str | None = None
    seed: int | None = None


def run_flow(path: Path, overrides: Sequence[str], part: Part, as_json: bool) -> None:
    """``juicer run``."""
    settings = read_settings()
    has_server = prepare_environment(settings)
    if settings.spread and not has_server:
        raise ServiceUnavailable(
            f"stages elsewhere need a Prefect server that all machines reach; set {API_VARIABLE} or unset JUICER_SPREAD"
        )
    configs = _load(path, overrides, part)
    store = open_store(settings)
    outcomes = []
    for config in configs:
        outcome = None if has_server else _reuse_everything(settings, config)
        if outcome is None:
            if not has_server:
                start_server(settings)
                has_server = True
            outcome = _run_in_prefect(config)
        outcomes.append(outcome.to_json(store))
        if not as_json:
            _say_outcome(outcome, config, store)
    if as_json:
        # A file with several tasks is told by a list.
        say_json(outcomes[0] if len(configs) == 1 else outcomes)


def _reuse_everything(settings: Settings, config: RunConfig) -> RunOutcome | None:
    """Outcome of a run of which everything is in the store; starting a Prefect server would show nothing new."""
    from flows.execution import execute
    from flows.opening import opened
    from flows.plan import is_complete

    if not is_complete(open_store(settings), config):
        return None
    with opened(settings, config) as surroundings:
        return execute(surroundings.session, config, surroundings.tracking)


def start_server(settings: Settings) -> None:
    """Start a Prefect server for this run, and point Prefect to it."""
    typer.echo("starting a Prefect server for this run ...", err=True)
    server = TemporaryServer()
    os.environ[API_VARIABLE] = server.api_url
    warm_up()
    server.wait(settings.startup_seconds)


def _run_in_prefect(config: RunConfig) -> RunOutcome:
    from flows.collect_infer import collect_infer
    from flows.config import StudyConfig
    from flows.study import study

    with server_loss_explained():
        return study(config) if isinstance(config, StudyConfig) else collect_infer(config)


@contextmanager
def server_loss_explained() -> Iterator[None]:
    """Say in one sentence that Prefect's server went away in mid-run.

    Raises:
        ServiceUnavailable: If it did.
    """
    import httpx

    try:
        yield
    except httpx.TransportError as error:
        raise ServiceUnavailable(
            f"the Prefect server went away ({error}); what was made is in the store, the same command goes on"
        ) from None


def run_stage(
    name: str,
    path: Path,
    overrides: Sequence[str],
    part: Part,
    force: bool,
    as_json: bool,
) -> None:
    """``juicer stage``."""
    settings = read_settings()
    has_server = prepare_environment(settings)
    from flows.plan import ready_calls
    from stages.catalog import find_stage

    find_stage(name)
    configs = _load(path, overrides, part)
    # What is wrong is better said before a server starts.
    for config in configs:
        ready_calls(open_store(settings), config, name)
    if not has_server:
        start_server(settings)
    from flows.single_stage import single_stage

    with server_loss_explained():
        refs = [ref for config in configs for ref in single_stage(name, config, force=force)]
    if as_json:
        say_json(refs)
    else:
        for ref in refs:
            say(ref)


def explain_stage(name: str, path: Path, overrides: Sequence[str], part: Part, as_json: bool) -> None:
    """``juicer explain``."""
    settings = read_settings()
    from flows.plan import calls_of, plan
    from juicer.artifacts.explain import explain
    from stages.catalog import find_stage

    find_stage(name)
    store = open_store(settings)
    explained = [
        (entry, explain(store, entry.call.recipe))
        for config in _load(path, overrides, part)
        for entry in calls_of(plan(store, config), name)
    ]
    if as_json:
        say_json(
            [
                {
                    "stage": name,
                    "for": entry.label,
                    "ref": str(found.ref),
                    "hit": found.hit,
                    "nearest": str(found.nearest.ref) if found.nearest else None,
                    "differences": [difference.sentence for difference in found.differences],
                }
                for entry, found in explained
            ]
        )
        return
    for entry, found in explained:
        first, *rest = found.sentences
        say(f"{name} ({entry.label}): {first}")
        for sentence in rest:
            say(f"  {sentence}")


def _load(path: Path, overrides: Sequence[str], part: Part) -> list[RunConfig]:
    from flows.config import load_runs

    configs = load_runs(path, overrides)
    tasks = [config.task for config in configs]
    if part.task is not None and part.task not in tasks:
        raise ConfigError(f"the configuration has no task '{part.task}'{did_you_mean(part.task, tasks)}")
    return [
        config.narrowed(_condition(part.condition), part.seed) for config in configs if part.task in (None, config.task)
    ]


def _condition(text: str | None) -> Condition | None:
    try:
        return None if text is None else Condition(text)
    except ValueError:
        raise ConfigError(f"unknown condition '{text}'{did_you_mean(str(text), Condition)}") from None


def _say_outcome(outcome: RunOutcome, config: RunConfig, store: ArtifactStore) -> None:
    from stages.report import PAGE

    rows = [
        [
            row.condition,
            f"{row.average:.0%}",
            f"{row.interval[0]:.0%} to {row.interval[1]:.0%}",
            f"{row.best:.0%}",
            str(row.num_models),
            str(row.num_episodes),
        ]
        for row in outcome.results(store)
    ]
    title = f"{config.task}, {config.randomness.value} randomness: success rates"
    say_table(["condition", "average ", "95 % interval ", "best ", "models ", "episodes "], rows, title)
    for finding in outcome.findings:
        say(finding)
    if outcome.report:
        folder = store.open(outcome.report)
        say("")
        say(f"report   {folder / PAGE}")
        for video in sorted(folder.glob("*.mp4")):
            say(f"video    {video}")
        say("pages    juicer ui   (Prefect's and MLflow's, on this machine)")
        say(f"lineage  juicer lineage {outcome.models[-1].evaluation.id}")
