"""Every model of a run, side by side, and what they come to together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextvars import copy_context
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import urlsplit

from flows.config import RunConfig
from flows.loop import ModelOutcome, run_model
from flows.running.settings import read_settings
from flows.running.tracking import Tracking
from juicer.artifacts.manifest import STATE
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.evaluation import ConditionResult
from juicer.reporting.comparison import ReportRow, condition_results
from stages.report import ReportConfig, report
from stages.runtime.context import Record
from stages.runtime.session import Session

POLL_SECONDS = 0.2

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

    def to_json(self, store: ArtifactStore) -> dict[str, Any]:
        """For machines."""
        return {
            "models": [
                {
                    "condition": model.condition,
                    "seed": model.seed,
                    "checkpoint": str(model.checkpoint),
                    "evaluation": str(model.evaluation),
                    "observes": model.observes or None,
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
                }
                for row in self.results(store)
            ],
            "findings": list(self.findings),
            "report": str(self.report) if self.report else None,
        }


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
    """
    chains: list[Callable[[], ModelOutcome]] = []
    for condition, seed in config.models:
        record: Record = tracking.model(condition, seed) if tracking else session.record
        scope = session.for_model(f"{condition} seed {seed}", record)
        chains.append(_chain(scope, config, condition, seed, tracking))
    if not parallel:
        return [chain() for chain in chains]
    with ThreadPoolExecutor(len(chains), thread_name_prefix="model") as pool:
        futures = [pool.submit(copy_context().run, chain) for chain in chains]
        _wait(futures, session)
    return [future.result() for future in futures]


def _chain(
    session: Session, config: RunConfig, condition: str, seed: int, tracking: Tracking | None
) -> Callable[[], ModelOutcome]:
    def chain() -> ModelOutcome:
        outcome = run_model(session, config, condition, seed)
        if tracking:
            tracking.finish(outcome)
        return outcome

    return chain


def _wait(futures: Sequence[Future[ModelOutcome]], session: Session) -> None:
    """Wait for all, but hear an interrupt from the keyboard at once and pass it on to the stages."""
    pending = set(futures)
    try:
        while pending:
            _, pending = wait(pending, timeout=POLL_SECONDS, return_when=FIRST_COMPLETED)
    except BaseException:
        session.stop.set()
        raise


def rows_of(models: Sequence[ModelOutcome]) -> tuple[tuple[ArtifactRef, ...], tuple[ReportRow, ...]]:
    """Evaluations of models, and whose they are."""
    return (
        tuple(model.evaluation for model in models),
        tuple(
            ReportRow(condition=model.condition, title=model.title, seed=model.seed, setting=model.setting)
            for model in models
        ),
    )


def write_report(session: Session, config: RunConfig, outcome: RunOutcome) -> ArtifactRef:
    """Make the page about the models."""
    evaluations, rows = rows_of(outcome.models)
    report_config = ReportConfig(
        title=config.name,
        task=config.task,
        rows=rows,
        curves=config.drawn_curves,
        findings=outcome.findings,
        facts=_facts(config, outcome.models),
        configuration=config.model_dump(mode="json"),
        links=_links(),
    )
    return report(session.for_model("", session.record), evaluations=evaluations, config=report_config)


def _facts(config: RunConfig, models: Sequence[ModelOutcome]) -> Mapping[str, str]:
    seen = dict.fromkeys(_SEEN.get(model.observes, model.observes) for model in models)
    return {
        "Task": config.task,
        "Randomness": config.randomness.value,
        "The policies see": "; or ".join(seen),
        "Seeds": ", ".join(map(str, config.seeds)),
        "Evaluation episodes a model": str(config.evaluate.episodes),
    }


def _links() -> Mapping[str, str]:
    """MLflow's pages, if they have an address that outlasts this run; without the credentials that it may hold."""
    try:
        parts = urlsplit(read_settings().tracking_uri)
    except ValueError:
        return {}
    if parts.scheme not in ("http", "https") or not parts.hostname:
        return {}
    place = parts.netloc.rpartition("@")[2]
    return {"MLflow": f"{parts.scheme}://{place}{parts.path.rstrip('/')}/#/experiments"}
