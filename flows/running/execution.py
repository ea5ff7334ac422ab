"""Every model of a run, side by side, and what they come to together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextvars import copy_context
from dataclasses import dataclass, replace
from functools import partial
from typing import Any
from urllib.parse import urlsplit

from flows.config import RunConfig
from flows.loop import ModelOutcome, evaluate_further, run_model
from flows.running.settings import read_settings
from flows.running.tracking import Tracking
from flows.stopping import episodes_in_words, num_episodes, open_conditions
from juicer.artifacts.manifest import STATE
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactNotFound
from juicer.evaluation import ConditionResult
from juicer.reporting.analyses import AnalysisRow
from juicer.reporting.comparison import ReportRow, condition_results
from juicer.reporting.sources import Sources
from juicer.shifts import Shift
from juicer.study.material import TaskStudy, task_study
from stages.report import ReportConfig, report
from stages.runtime.context import Record
from stages.runtime.session import Session
from stages.tracking.destination import without_credentials

POLL_SECONDS = 0.2

ModelKey = tuple[str, int]
"""Condition and seed of a model."""

_POSES = "poses of the robot and the parts, no images"
_SEEN = {"": _POSES, STATE: _POSES, "images": "images of cameras and the robot's own readings, no poses of parts"}
"""What policies see, in more words."""


@dataclass(frozen=True)
class RunOutcome:
    """What a run comes to.

    Attributes:
        models: One entry a condition and seed, in their order.
        report: The page about them; none before it is written.
    """

    models: tuple[ModelOutcome, ...]
    report: ArtifactRef | None

    @property
    def findings(self) -> tuple[str, ...]:
        """Why some models learned from less than they should."""
        return tuple(f"{model.title}, seed {model.seed}: {model.finding}" for model in self.models if model.finding)

    def results(self, store: ArtifactStore) -> list[ConditionResult]:
        """Rows of the comparison."""
        return condition_results(store, *rows_of(self.models))

    def comparison(self, store: ArtifactStore) -> tuple[list[str], list[list[str]]]:
        """Columns and rows of the table of success rates."""
        columns = ["condition", "average", "95 % interval", "best", "models", "episodes"]
        rows = [
            [
                row.title,
                f"{row.average:.0%}",
                f"{row.interval[0]:.0%} to {row.interval[1]:.0%}",
                f"{row.best:.0%}",
                str(row.num_models),
                str(row.num_episodes),
            ]
            for row in self.results(store)
        ]
        return columns, rows

    def to_json(self, store: ArtifactStore) -> dict[str, Any]:
        """For machines."""
        return {
            "models": [
                {
                    "condition": model.condition,
                    "seed": model.seed,
                    "checkpoint": str(model.checkpoint),
                    "evaluation": str(model.evaluation),
                    "shifted": {name: ref and str(ref) for name, ref in model.shifted.items()},
                    "observes": model.observes or None,
                    "analyses": {name: str(ref) for name, ref in model.analyses.items()},
                    "finding": model.finding or None,
                }
                for model in self.models
            ],
            "table": [
                {
                    "condition": row.condition,
                    "title": row.title,
                    "average": row.average,
                    "interval": list(row.interval),
                    "best": row.best,
                    "models": row.num_models,
                    "episodes": row.num_episodes,
                    "shifted": {
                        name: under and {"average": under.average, "interval": list(under.interval)}
                        for name, under in row.shifted.items()
                    },
                }
                for row in self.results(store)
            ],
            "findings": list(self.findings),
            "report": str(self.report) if self.report else None,
        }


def comparison_title(config: RunConfig) -> str:
    """What a run's table of success rates is about."""
    return f"{config.task}, {' and '.join(config.levels)} randomness: success rates"


def execute(session: Session, config: RunConfig, tracking: Tracking | None) -> RunOutcome:
    """Run every model, write the report, and have both recorded."""
    models = run_models(session, config, tracking)
    outcome = RunOutcome(tuple(models), None)
    page = write_report(session, config, outcome)
    if tracking:
        tracking.conclude(page)
    return replace(outcome, report=page)


def run_models(
    session: Session, config: RunConfig, tracking: Tracking | None = None, *, parallel: bool = True
) -> list[ModelOutcome]:
    """Outcomes of every condition and seed, seeds outermost.

    In parallel, each model has a thread that does nothing but wait; how many stages really run at a time is the
    task runner's business. If some fail, the others run to their ends before the first failure is raised.

    Where evaluations may stop, all models are evaluated on a first block of initial states before it is looked who
    needs more. A model is recorded when it is settled, and in the end, also if others fail.
    """
    models: dict[ModelKey, ModelOutcome] = {}

    def advance(key: ModelKey) -> None:
        record: Record = tracking.model(*key) if tracking else session.record
        scope = session.for_model(_label(key), record)
        if key in models:
            models[key] = evaluate_further(scope, config, models[key])
        else:
            models[key] = run_model(scope, config, *key)
        if config.evaluate.stop is None:
            finish([key])

    def finish(keys: Iterable[ModelKey]) -> None:
        for key in keys:
            session.display.settled(_label(key))
            if tracking and key in models:
                tracking.finish(models[key])

    waiting = list(config.models)
    try:
        while waiting:
            _together([partial(advance, key) for key in waiting], session, parallel=parallel)
            waiting = _to_be_continued(session, config, models)
            finish(key for key in config.models if key not in waiting)
    finally:
        finish(config.models)
    return [models[key] for key in config.models]


def _label(key: ModelKey) -> str:
    return f"{key[0]} seed {key[1]}"


def _together(actions: Sequence[Callable[[], None]], session: Session, *, parallel: bool) -> None:
    if not parallel:
        for action in actions:
            action()
        return
    with ThreadPoolExecutor(len(actions), thread_name_prefix="model") as pool:
        futures = [pool.submit(copy_context().run, action) for action in actions]
        _wait(futures, session)
    for future in futures:
        future.result()


def _to_be_continued(session: Session, config: RunConfig, models: Mapping[ModelKey, ModelOutcome]) -> list[ModelKey]:
    """Models that are evaluated on further episodes: those of conditions that are open, if they have some left."""
    stop = config.evaluate.stop
    if stop is None:
        return []
    most = {name: config.loop(name).evaluate.episodes for name in config.chosen}
    left = [key for key in config.models if num_episodes(session, models[key].evaluation) < most[key[0]]]
    try:
        going_on = open_conditions(_usual_study(session.store, config, models.values()), stop) if left else {}
    except ArtifactNotFound:
        return left  # a run in thought: it may need them all
    return [key for key in left if key[0] in going_on]


def _usual_study(store: ArtifactStore, config: RunConfig, models: Iterable[ModelOutcome]) -> TaskStudy:
    """What the report tells of models, without shifts and without what they were made from."""
    rows = rows_of([replace(model, shifted={}) for model in models])
    return task_study(store, config.task, *rows, sources=Sources(store, (), ()))


def _wait(futures: Sequence[Future[None]], session: Session) -> None:
    """Wait for all, but hear an interrupt from the keyboard at once and pass it on to the stages."""
    pending = set(futures)
    try:
        while pending:
            _, pending = wait(pending, timeout=POLL_SECONDS, return_when=FIRST_COMPLETED)
    except BaseException:
        session.stop.set()
        raise


def rows_of(models: Sequence[ModelOutcome]) -> tuple[tuple[ArtifactRef, ...], tuple[ReportRow, ...]]:
    """Evaluations of models, and whose they are; behind each model's usual one, those under shifts."""
    pairs = [
        (ref, model_row.model_copy(update={"shift": shift}))
        for model in models
        for model_row in [_row(model)]
        for shift, ref in {"": model.evaluation, **model.shifted}.items()
        if ref
    ]
    return tuple(ref for ref, _ in pairs), tuple(row for _, row in pairs)


def analyses_of(models: Sequence[ModelOutcome]) -> tuple[tuple[ArtifactRef, ...], tuple[AnalysisRow, ...]]:
    """Analyses of models, and whose they are."""
    found = [
        (ref, AnalysisRow(name=name, condition=model.condition, title=model.title, seed=model.seed))
        for model in models
        for name, ref in model.analyses.items()
    ]
    return tuple(ref for ref, _ in found), tuple(row for _, row in found)


def _row(model: ModelOutcome) -> ReportRow:
    return ReportRow(
        condition=model.condition,
        title=model.title,
        seed=model.seed,
        setting=model.setting,
        method=model.method,
        unnoticed=tuple(name for name, ref in model.shifted.items() if ref is None),
    )


def write_report(session: Session, config: RunConfig, outcome: RunOutcome) -> ArtifactRef:
    """Make the page about the models."""
    evaluations, rows = rows_of(outcome.models)
    analyses, analysis_rows = analyses_of(outcome.models)
    report_config = ReportConfig(
        title=config.name,
        task=config.task,
        rows=rows,
        analyses=analysis_rows,
        curves=config.drawn_curves,
        findings=outcome.findings,
        facts=_facts(config, outcome, session.store),
        configuration=config.model_dump(mode="json"),
        links=_links(),
    )
    return report(
        session.for_model("", session.record),
        evaluations=evaluations,
        analyses=analyses,
        config=report_config,
    )


def _facts(config: RunConfig, outcome: RunOutcome, store: ArtifactStore) -> Mapping[str, str]:
    seen = dict.fromkeys(_SEEN.get(model.observes, model.observes) for model in outcome.models)
    loops = [config.loop(name) for name in config.chosen]
    shifts = dict.fromkeys(_in_words(*entry) for name in config.chosen for entry in config.shifts_of(name).items())
    stop = config.evaluate.stop
    episodes = " or ".join(dict.fromkeys(str(loop.evaluate.episodes) for loop in loops))
    if stop:
        episodes = f"at most {episodes}: {episodes_in_words(_usual_study(store, config, outcome.models), stop)}"
    return {
        "Task": config.task,
        "Randomness": ", ".join(config.levels),
        "The policies see": "; or ".join(seen),
        "Seeds": ", ".join(map(str, config.seeds)),
        "Evaluation episodes a model": episodes,
        **({"Shifts": "; ".join(shifts) + (", all episodes" if stop else "")} if shifts else {}),
    }


def _in_words(name: str, shift: Shift) -> str:
    settings = ", ".join(f"{key} {value}" for key, value in shift.model_dump(exclude={"kind"}).items())
    return f"{name}: {shift.phrase} ({settings})"


def _links() -> Mapping[str, str]:
    """MLflow's pages, if they have an address that outlasts this run; without the credentials that it may hold."""
    address = read_settings().tracking_uri
    try:
        parts = urlsplit(address)
    except ValueError:
        return {}
    if parts.scheme not in ("http", "https") or not parts.hostname:
        return {}
    return {"MLflow": f"{without_credentials(address).rstrip('/')}/#/experiments"}
