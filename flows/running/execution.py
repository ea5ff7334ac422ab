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
from flows.stopping import StopConfig, num_episodes, told, unsettled
from juicer.artifacts.manifest import STATE
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactNotFound
from juicer.evaluation import ConditionResult
from juicer.reporting.analyses import AnalysisRow
from juicer.reporting.comparison import ReportRow, condition_results
from juicer.shifts import Shift
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
    needs more.
    """
    chain = partial(_chain, session, config, tracking)
    models = _together(
        [chain(name, seed, partial(run_model, config=config, name=name, seed=seed)) for name, seed in config.models],
        session,
        parallel=parallel,
    )
    while places := _to_be_continued(session, config, models):
        waiting = [models[place] for place in places]
        further = [
            chain(model.condition, model.seed, partial(evaluate_further, config=config, model=model))
            for model in waiting
        ]
        for place, model in zip(places, _together(further, session, parallel=parallel), strict=True):
            models[place] = model
    if tracking and config.evaluate.stop:
        for model in models:
            tracking.finish(model)
    return models


def _chain(
    session: Session,
    config: RunConfig,
    tracking: Tracking | None,
    condition: str,
    seed: int,
    make: Callable[[Session], ModelOutcome],
) -> Callable[[], ModelOutcome]:
    record: Record = tracking.model(condition, seed) if tracking else session.record
    scope = session.for_model(f"{condition} seed {seed}", record)

    def chain() -> ModelOutcome:
        outcome = make(scope)
        # One that may be evaluated further is not finished: its records would tell of a first block.
        if tracking and config.evaluate.stop is None:
            tracking.finish(outcome)
        return outcome

    return chain


def _together(chains: Sequence[Callable[[], ModelOutcome]], session: Session, *, parallel: bool) -> list[ModelOutcome]:
    if not parallel:
        return [chain() for chain in chains]
    with ThreadPoolExecutor(len(chains), thread_name_prefix="model") as pool:
        futures = [pool.submit(copy_context().run, chain) for chain in chains]
        _wait(futures, session)
    return [future.result() for future in futures]


def _to_be_continued(session: Session, config: RunConfig, models: Sequence[ModelOutcome]) -> list[int]:
    """Places of the models that are evaluated on further episodes: those of conditions that are not settled."""
    stop = config.evaluate.stop
    if stop is None:
        return []
    further = {name for group in _comparable(config, models) for name in _unsettled(session, config, stop, group)}
    return [place for place, model in enumerate(models) if model.condition in further]


def _comparable(config: RunConfig, models: Sequence[ModelOutcome]) -> Iterable[list[ModelOutcome]]:
    """Models by what they are evaluated on: only on the same initial states are episodes compared in pairs."""
    groups: dict[str, list[ModelOutcome]] = {}
    for model in models:
        groups.setdefault(config.loop(model.condition).evaluation.model_dump_json(), []).append(model)
    return groups.values()


def _unsettled(session: Session, config: RunConfig, stop: StopConfig, models: Sequence[ModelOutcome]) -> set[str]:
    """Conditions of comparable models that need further episodes, and have some left."""
    episodes = {model.condition: num_episodes(session, model.evaluation) for model in models}
    first, most = models[0].condition, config.loop(models[0].condition).evaluate.episodes
    try:
        names = unsettled(condition_results(session.store, *rows_of(models)), stop)
    except ArtifactNotFound:
        names = list(episodes)  # a run in thought: it may need them all
    further = {name for name in names if episodes[name] < most}
    # Episodes are compared in pairs: the first condition keeps up with those that are compared with it.
    if stop.comparison and any(episodes[name] >= episodes[first] for name in further):
        further.add(first)
    return further


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
    """Evaluations of models, and whose they are; behind each model's usual one, those under shifts."""
    pairs = [
        (ref, model_row.model_copy(update={"shift": shift}))
        for model in models
        for model_row in [_row(model)]
        for shift, ref in {"": model.evaluation, **model.shifted}.items()
        if ref
    ]
    return tuple(ref for ref, _ in pairs), tuple(row for _, row in pairs)


def _row(model: ModelOutcome) -> ReportRow:
    return ReportRow(
        condition=model.condition,
        title=model.title,
        seed=model.seed,
        setting=model.setting,
        unnoticed=tuple(name for name, ref in model.shifted.items() if ref is None),
    )


def write_report(session: Session, config: RunConfig, outcome: RunOutcome) -> ArtifactRef:
    """Make the page about the models."""
    evaluations, rows = rows_of(outcome.models)
    found = [(model, name, ref) for model in outcome.models for name, ref in model.analyses.items()]
    report_config = ReportConfig(
        title=config.name,
        task=config.task,
        rows=rows,
        analyses=tuple(AnalysisRow(name=name, title=model.title, seed=model.seed) for model, name, _ in found),
        curves=config.drawn_curves,
        findings=outcome.findings,
        facts=_facts(config, outcome, session.store),
        configuration=config.model_dump(mode="json"),
        links=_links(),
    )
    return report(
        session.for_model("", session.record),
        evaluations=evaluations,
        analyses=tuple(ref for _, _, ref in found),
        config=report_config,
    )


def _facts(config: RunConfig, outcome: RunOutcome, store: ArtifactStore) -> Mapping[str, str]:
    seen = dict.fromkeys(_SEEN.get(model.observes, model.observes) for model in outcome.models)
    episodes, stop = str(config.evaluate.episodes), config.evaluate.stop
    return {
        "Task": config.task,
        "Randomness": config.randomness.value,
        "The policies see": "; or ".join(seen),
        "Seeds": ", ".join(map(str, config.seeds)),
        "Evaluation episodes a model": f"at most {episodes}: {'; '.join(_stops(config, outcome, store, stop))}"
        if stop
        else episodes,
        **({"Shifts": "; ".join(_told(*entry) for entry in config.shifts.items())} if config.shifts else {}),
    }


def _stops(config: RunConfig, outcome: RunOutcome, store: ArtifactStore, stop: StopConfig) -> list[str]:
    """Why evaluations ended."""
    groups = _comparable(config, outcome.models)
    return [told(condition_results(store, *rows_of(group)), stop) for group in groups]


def _told(name: str, shift: Shift) -> str:
    settings = ", ".join(f"{key} {value}" for key, value in shift.model_dump(exclude={"kind"}).items())
    return f"{name}: {shift.phrase} ({settings})"


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
