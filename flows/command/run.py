"""Commands that run flows, or tell what they would do."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import asdict
from typing import TYPE_CHECKING

import typer

from flows.command.choice import Choice
from flows.command.recordings import find_recordings, say_recordings
from flows.running.data_folder import open_store
from flows.running.device import check_device
from flows.running.flow_runs import mark_crashed
from flows.running.services import find_pages
from flows.running.settings import RUNNER_VARIABLE, Settings, read_settings
from flows.servers.acquaintance import check_prefect
from flows.servers.addresses import check_reachable
from flows.servers.environment import API_VARIABLE, PASSWORD_VARIABLE, prepare_environment
from flows.servers.temporary import TemporaryServer
from flows.servers.watch import PATIENCE_SECONDS, ServerWatch, is_reachable
from flows.terminal.headline import duration
from flows.terminal.output import say, say_json, say_table
from juicer.artifacts.ref import ArtifactRef
from juicer.errors import JuicerError, ServiceUnavailable
from juicer.pages.addresses import lineage_of
from stages.runtime.isolation import warm_up

if TYPE_CHECKING:
    from flows.config import RunConfig
    from flows.running.execution import RunOutcome
    from flows.running.plan import PlannedCall
    from juicer.artifacts.store import ArtifactStore


def run_flow(choice: Choice, as_json: bool) -> None:
    """``juicer run``."""
    configs = choice.runs()
    settings = read_settings()
    check_device(settings)
    has_server = prepare_environment(settings)
    _check_cluster(settings, has_server)
    store = open_store(settings)
    outcomes = []
    watch = watch_server(settings) if has_server else None
    for config in configs:
        outcome = None if watch else _reuse_everything(settings, config)
        if outcome is None:
            watch = watch or start_server(settings)
            outcome = _run_in_prefect(config, watch)
        outcomes.append({"name": config.name, "task": config.task, **outcome.to_json(store)})
        if not as_json:
            _say_outcome(outcome, config, store, find_pages(settings.folder))
    if as_json:
        # A file with several tasks is told by a list.
        say_json(outcomes[0] if len(configs) == 1 else outcomes)
    if watch:
        watch.finish()


def preview_flow(choice: Choice, as_json: bool) -> None:
    """``juicer run --dry-run``; starts no server, computes nothing and writes nothing."""
    settings = read_settings()
    from flows.command.preview import preview, total_seconds
    from flows.running.plan import plan

    store, configs = open_store(settings), choice.runs()
    planned = plan(store, *configs)
    runs = preview(store, configs, planned)
    calls = [call for each in runs for call in each]
    to_come = [call for call in calls if not call.is_reused]
    seconds, unknown = total_seconds(runs, settings.workers), sum(call.seconds is None for call in to_come)
    if as_json:
        totals = {"reused": len(calls) - len(to_come), "computed": len(to_come), "seconds": seconds, "unknown": unknown}
        told = [asdict(call) | {"ref": call.ref and str(call.ref)} for call in calls]
        say_json({"calls": told, **totals, "lacks": _lack_of(settings, planned)})
        return
    rows = [
        [
            call.stage,
            call.label,
            "reused" if call.is_reused else "computed",
            "unknown" if call.seconds is None else duration(call.seconds),
            call.reason,
        ]
        for call in calls
    ]
    say_table(["stage", "for", "", "took ", "why"], rows)
    forecast = f"{len(calls) - len(to_come)} reused, {len(to_come)} to be computed"
    if unknown < len(to_come):
        forecast += f": about {duration(seconds)} or more, if they take their time like the most similar ones"
        forecast += f"; {unknown} of them never ran and are not counted" if unknown else ""
    elif to_come:
        forecast += ": none like them ever ran, so nobody knows how long they take"
    say(forecast)
    if any(call.stage == "select" for call in to_come):
        say("a selection that keeps nothing ends its round; here each is assumed to keep something")
    if lack := _lack_of(settings, planned):
        say(f"the run would be refused: {lack}")


def _lack_of(settings: Settings, planned: Sequence[PlannedCall]) -> str:
    """What a run lacks to begin, as a sentence; empty if nothing. Machines of a cluster are not looked at."""
    from flows.running.plan import require_drawing, require_weights

    if settings.cluster:
        return ""
    try:
        require_weights(planned, settings.machine.weights)
        require_drawing(planned)
    except JuicerError as error:
        return str(error)
    return ""


def _reuse_everything(settings: Settings, config: RunConfig) -> RunOutcome | None:
    """Outcome of a run of which everything is in the store; starting a Prefect server would show nothing new."""
    from flows.running.context import open_run
    from flows.running.execution import execute
    from flows.running.plan import is_complete

    if not is_complete(open_store(settings), config):
        return None
    with open_run(settings, config) as run_context:
        return execute(run_context.session, config, run_context.tracking)


def _check_cluster(settings: Settings, has_server: bool) -> None:
    """Refuse a cluster that nobody answers for, or that could not reach the Prefect server of this run alone."""
    if not settings.cluster:
        return
    if not has_server:
        raise ServiceUnavailable(
            f"a cluster needs a Prefect server that its machines reach; set {API_VARIABLE}, or unset {RUNNER_VARIABLE}"
        )
    check_reachable("cluster", settings.cluster, f"start it, or unset {RUNNER_VARIABLE}")


def start_server(settings: Settings) -> ServerWatch:
    """Start a Prefect server for this run, and point Prefect to it."""
    typer.echo("starting a Prefect server for this run ...", err=True)
    server = TemporaryServer()
    os.environ.update(server.variables)
    if settings.runner_kind == "threads":
        warm_up()
    server.wait(settings.startup_seconds)
    _mark_crashed(settings)
    return ServerWatch(lambda: not server.has_ended, patience_s=0.0)


def watch_server(settings: Settings) -> ServerWatch:
    """Look after the Prefect server that is running already.

    Raises:
        ServiceUnavailable: If it cannot be used.
    """
    url = os.environ[API_VARIABLE]
    check_prefect(url)
    _mark_crashed(settings)
    return ServerWatch(lambda: is_reachable(url), PATIENCE_SECONDS)


def _mark_crashed(settings: Settings) -> None:
    mark_crashed(settings.folder, os.environ[API_VARIABLE], os.environ.get(PASSWORD_VARIABLE))


def _run_in_prefect(config: RunConfig, watch: ServerWatch) -> RunOutcome:
    # Whatever libraries print, the answer alone goes to standard output.
    from flows.collect_infer import collect_infer
    from flows.config import StudyConfig
    from flows.study import study

    with watch.explaining(), redirect_stdout(sys.stderr):
        return study(config) if isinstance(config, StudyConfig) else collect_infer(config)


def run_stage(name: str, choice: Choice, force: bool, as_json: bool) -> None:
    """``juicer stage``."""
    configs = choice.runs()
    settings = read_settings()
    check_device(settings)
    has_server = prepare_environment(settings)
    _check_cluster(settings, has_server)
    from flows.running.plan import ready_calls
    from stages.runtime.catalog import find_stage

    find_stage(name)
    # What is wrong is better said before a server starts.
    ready_calls(open_store(settings), configs, name)
    watch = watch_server(settings) if has_server else start_server(settings)
    from flows.single_stage import single_stage

    with watch.explaining(), redirect_stdout(sys.stderr):
        refs = single_stage(name, configs, force=force)
    if as_json:
        say_json(refs)
    else:
        store = open_store(settings)
        for ref in refs:
            say(ref)
            say_recordings(find_recordings(store, ArtifactRef.parse(ref)))
    watch.finish()


def explain_stage(name: str, choice: Choice, as_json: bool) -> None:
    """``juicer explain``."""
    settings = read_settings()
    from flows.running.plan import calls_of, explainer, plan
    from stages.runtime.catalog import find_stage

    find_stage(name)
    store = open_store(settings)
    planned = plan(store, *choice.runs())
    explaining = explainer(store, planned)
    explained = [(entry, explaining.explain(entry.call.recipe)) for entry in calls_of(planned, name)]
    if as_json:
        say_json(
            [
                {
                    "stage": name,
                    "task": entry.config.task,
                    "for": entry.label,
                    "ref": str(found.ref),
                    "hit": found.hit,
                    "nearest": str(found.nearest.ref) if found.nearest else None,
                    "differences": found.reasons,
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


def _say_outcome(outcome: RunOutcome, config: RunConfig, store: ArtifactStore, pages: str) -> None:
    from flows.running.execution import comparison_title
    from juicer.reporting.comparison import robustness_table
    from stages.report import PAGE

    columns, rows = outcome.comparison(store)
    _say_rates(columns, rows, comparison_title(config))
    columns, under_shifts = robustness_table(outcome.results(store))
    if columns:
        say("")
        _say_rates(columns, under_shifts, "under shifts")
    for finding in outcome.findings:
        say(finding)
    if outcome.report:
        folder = store.open(outcome.report)
        say("")
        say(f"report   {folder / PAGE}")
        for video in sorted(folder.glob("*.mp4")):
            say(f"video    {video}")
        evaluation = outcome.models[-1].evaluation
        say("pages    juicer pages   (its episodes and lineage); juicer ui   (Prefect's and MLflow's)")
        say(f"lineage  {lineage_of(str(evaluation), pages) if pages else f'juicer lineage {evaluation.id}'}")


def _say_rates(columns: Sequence[str], rows: Sequence[Sequence[str]], title: str) -> None:
    first, *numbers = columns
    say_table([first, *(f"{column} " for column in numbers)], rows, title)
