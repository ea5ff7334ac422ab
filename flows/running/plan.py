"""Run a flow in thought: which stages it would call, with which recipes, without executing any."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from flows.config import RunConfig
from flows.loop import ModelOutcome, evaluate_further, run_model
from flows.running.execution import RunOutcome, run_models, write_report
from flows.stopping import num_episodes
from juicer.artifacts.explain import Explainer
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import models_in
from juicer.errors import ConfigError, did_you_mean
from juicer.policy.pretrained.config import Weights
from juicer.policy.pretrained.files import read_weights_file
from juicer.views import View
from stages.runtime.session import Session
from stages.runtime.stage import StageCall


@dataclass(frozen=True)
class PlannedCall:
    """A stage call that the flow would make.

    Attributes:
        call: The call.
        config: The run that makes it, of several the first.
        label: Condition, seed and round that it is made for first, and the task where runs are for several.
        exists: Whether its artifact is in the store.
    """

    call: StageCall
    config: RunConfig
    label: str
    exists: bool

    @property
    def stage(self) -> str:
        """Name of the stage."""
        return self.call.stage.name

    @property
    def ref(self) -> ArtifactRef:
        """The artifact it makes."""
        return self.call.recipe.ref

    def perform(self, session: Session) -> ArtifactRef:
        """Make the call after all."""
        return session.for_model(self.label, session.record).perform(self.call)


def plan(store: ArtifactStore, *configs: RunConfig) -> list[PlannedCall]:
    """Every call of one or several runs once, in an order in which they can be made.

    The report, which depends on what the evaluations found, is among them only once these exist.
    """
    planned: dict[str, PlannedCall] = {}
    has_tasks = len({config.task for config in configs}) > 1
    for config in configs:
        _plan(planned, store, config, f"{config.task} " if has_tasks else "")
    return list(planned.values())


def _plan(planned: dict[str, PlannedCall], store: ArtifactStore, config: RunConfig, prefix: str) -> None:
    """Add the calls of a run that earlier ones do not make."""
    own: list[PlannedCall] = []

    def perform(call: StageCall, session: Session) -> ArtifactRef:
        if call.recipe.id not in planned:
            exists = store.find(call.recipe) is not None
            planned[call.recipe.id] = PlannedCall(call, config, f"{prefix}{session.label}".rstrip(), exists)
        own.append(planned[call.recipe.id])
        return call.recipe.ref

    session = Session(store, performer=perform)
    models = run_models(session, config, parallel=False)
    if all(entry.exists for entry in own if entry.stage == "evaluate"):
        write_report(session, config, RunOutcome(tuple(models), None))


def evaluated_models(store: ArtifactStore, config: RunConfig) -> tuple[list[ModelOutcome], int]:
    """Models of a run whose evaluations are in the store, as far as these go, and how many models the run has."""

    def perform(call: StageCall, session: Session) -> ArtifactRef:
        return call.recipe.ref

    session = Session(store, performer=perform)
    models = [run_model(session, config, name, seed) for name, seed in config.models]
    known = [model for model in models if store.exists(model.evaluation)]
    alike = ([model for model in known if model.condition == name] for name in config.chosen)
    return [model for each in alike for model in _as_far_as_known(session, config, each)], len(models)


def _as_far_as_known(session: Session, config: RunConfig, models: Sequence[ModelOutcome]) -> list[ModelOutcome]:
    """Models of a condition with the longest evaluations that all of them have, and what else of them exists."""
    exists = session.store.exists
    most = config.loop(models[0].condition).evaluate.episodes if models else 0
    while models and num_episodes(session, models[0].evaluation) < most:
        further = [evaluate_further(session, config, model) for model in models]
        if not all(exists(model.evaluation) for model in further):
            break
        models = further
    return [
        replace(
            model,
            shifted={name: ref for name, ref in model.shifted.items() if ref is None or exists(ref)},
            analyses={name: ref for name, ref in model.analyses.items() if exists(ref)},
        )
        for model in models
    ]


def require_weights(planned: Iterable[PlannedCall], folder: Path) -> None:
    """Refuse a run that would lack a file of weights, before hours of work that lead there.

    Raises:
        UnusableWeights: If a call that is still to be made needs one that is missing or another one than meant.
    """
    needed = [model for each in planned if not each.exists for model in models_in(each.call.arguments)]
    for weights in dict.fromkeys(model for model in needed if isinstance(model, Weights)):
        read_weights_file(weights, folder)


def require_drawing(planned: Iterable[PlannedCall]) -> None:
    """Refuse a run that would draw what policies look at where nothing can draw, before the work that leads there.

    Raises:
        RenderingUnavailable: If a call that is still to be made has a view, and no OpenGL platform can draw.
    """
    from juicer.imaging.gl import gl_name  # only where it is needed: it loads the platform's libraries

    needed = (model for each in planned if not each.exists for model in models_in(each.call.arguments))
    if any(isinstance(model, View) for model in needed):
        gl_name()


def is_complete(store: ArtifactStore, config: RunConfig) -> bool:
    """Whether everything that a run makes is in the store."""

    def perform(call: StageCall, session: Session) -> ArtifactRef:
        if store.find(call.recipe) is None:
            raise _MissingError
        return call.recipe.ref

    session = Session(store, performer=perform)
    try:
        models = run_models(session, config, parallel=False)
        write_report(session, config, RunOutcome(tuple(models), None))
    except _MissingError:
        return False
    return True


def explainer(store: ArtifactStore, planned: Sequence[PlannedCall]) -> Explainer:
    """Explains the calls of a plan, each in the words of its run's configuration."""
    sections = {entry.ref: _section(entry.config, entry.call.recipe) for entry in planned}
    return Explainer(store, [entry.call.recipe for entry in planned], sections)


def _section(config: RunConfig, recipe: Recipe) -> str:
    """Where a configuration holds the settings of a stage call; of two sections that say the same, the first."""
    if recipe.stage == "train":
        for name, section in config.policies.items():
            if section.training.steps != recipe.config["training"]["steps"]:
                continue
            if section.policy.model_dump(mode="json") == recipe.config["policy"]:
                return f"policies.{name}"
    retraining = config.augment_retraining
    if recipe.stage == "augment" and retraining not in (None, config.augment):
        return "augment" if config.augment.model_dump(mode="json") == recipe.config else "augment_retraining"
    return recipe.stage


class _MissingError(Exception):
    """An artifact is not in the store."""


def calls_of(planned: Iterable[PlannedCall], stage: str) -> list[PlannedCall]:
    """Calls of one stage.

    Raises:
        ConfigError: If there are none.
    """
    planned = list(planned)
    chosen = [entry for entry in planned if entry.stage == stage]
    if not chosen and stage == "report":
        raise ConfigError("the report needs evaluations that are not in the store; run `juicer run` first")
    if not chosen:
        known = {entry.stage for entry in planned}
        raise ConfigError(f"this configuration has no stage '{stage}'{did_you_mean(stage, known)}")
    return chosen


def ready_calls(store: ArtifactStore, configs: Sequence[RunConfig], stage: str) -> list[PlannedCall]:
    """Calls of one stage that runs make, all of whose inputs are in the store: those of later rounds may wait.

    Raises:
        ConfigError: If no run has such a stage, or an input of each of its calls is not there yet.
    """
    planned = plan(store, *configs)
    chosen = calls_of(planned, stage)
    ready = [entry for entry in chosen if not missing_inputs(entry, planned)]
    if not ready:
        missing = missing_inputs(chosen[0], planned)
        raise ConfigError(
            f"stage '{stage}' ({chosen[0].label}) needs what {', '.join(missing)} makes, and the store lacks it; "
            f"run `juicer run`, or `juicer stage {_first_to_make(chosen[0], planned).stage}` first"
        )
    return ready


def _first_to_make(entry: PlannedCall, planned: Iterable[PlannedCall]) -> PlannedCall:
    """Of all that a call needs and the store lacks, something that can be made at once."""
    made_by = {other.ref: other for other in planned if not other.exists}
    while needed := [made_by[ref] for ref in entry.call.recipe.parents if ref in made_by]:
        entry = needed[0]
    return entry


def missing_inputs(entry: PlannedCall, planned: Iterable[PlannedCall]) -> list[str]:
    """Names of the stages whose artifacts a call needs and the store lacks."""
    made_by = {other.ref: other.stage for other in planned if not other.exists}
    return sorted({made_by[ref] for ref in entry.call.recipe.parents if ref in made_by})
