"""Show models in MLflow: what is there already is left alone, what is missing is computed from artifacts.

A run is found by a tag, and another tells that it is complete. Publishing twice, after a kill or from a copy of the
data folder therefore changes nothing, and an empty MLflow is filled again. What was deleted in MLflow stays so.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from mlflow import MlflowClient
from mlflow.entities import DatasetInput, LifecycleStage, Metric, Param, Run, RunTag, ViewType
from mlflow.exceptions import MlflowException
from mlflow.protos.databricks_pb2 import RESOURCE_ALREADY_EXISTS, ErrorCode

from juicer.artifacts.manifest import STATE, Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import TrackingError
from juicer.evaluation import ConditionResult
from juicer.reporting.comparison import ReportRow, condition_results, markdown_table
from juicer.reporting.lineage_page import lineage_page
from juicer.storage.curves import read_curves
from juicer.storage.evaluations import read_evaluation
from stages.tracking import entries
from stages.tracking.destination import reason
from stages.tracking.history import History, read_history
from stages.tracking.model import Model

KEY, COMPLETE, PAGES, NOTE = "juicer.model", "juicer.complete", "juicer.pages", "mlflow.note.content"
BATCH, PARAMS_BATCH = 1000, 100
"""Entries that MLflow takes at a time."""


@dataclass
class Published:
    """What came of publishing.

    Attributes:
        experiments: Id of the experiment of each study.
        problems: What could not be shown, a sentence each.
    """

    experiments: dict[str, str] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


def publish(
    client: MlflowClient,
    store: ArtifactStore,
    models: Iterable[Model],
    artifact_root: Path | None = None,
    pages: str = "",
) -> Published:
    """Show models, each on its own: what is wrong with one of them does not concern the others.

    Args:
        client: Speaks with MLflow.
        store: Where the artifacts are.
        models: What to show, oldest first; of two with the same key, the last.
        artifact_root: Where files of new experiments go; the server decides if None.
        pages: Address of juicer's pages, to which records link; empty if they are not served.

    Raises:
        Exception: Of whatever kind the libraries on the way raise, if MLflow no longer answers.
    """
    published = Published()
    studies: dict[str, dict[str, Model]] = {}
    for model in models:
        studies.setdefault(model.study, {})[model.key] = model
    for study, same in studies.items():
        try:
            page = Study(client, store, study, artifact_root, pages)
            published.experiments[study] = page.experiment
        except TrackingError as error:
            published.problems.append(str(error))
            continue
        published.problems += page.show(list(same.values()))
    return published


class Study:
    """An experiment of MLflow, and the runs in it that were made here."""

    def __init__(
        self, client: MlflowClient, store: ArtifactStore, name: str, artifact_root: Path | None, pages: str = ""
    ) -> None:
        """Find the experiment, or make it.

        Raises:
            TrackingError: If it was deleted in MLflow.
        """
        self._client = client
        self._store = store
        self._pages = pages
        found = client.get_experiment_by_name(name)
        if found and found.lifecycle_stage == LifecycleStage.DELETED:
            raise TrackingError(
                f"the experiment '{name}' was deleted in MLflow, so nothing is recorded in it; bring it back with "
                f"`mlflow experiments restore -x {found.experiment_id}`, or give the study another name"
            )
        # Without its kind, it opens as one about language models.
        tags = {"mlflow.experimentKind": "custom_model_development"}
        location = (artifact_root / name).as_uri() if artifact_root else _location(client, name)
        self.experiment: str = found.experiment_id if found else client.create_experiment(name, location, tags)
        self._tags: Mapping[str, str] = found.tags if found else {}
        self._histories: dict[str, History] = {}
        self._runs = {run.data.tags[KEY]: run for run in self._search()}

    def find(self, key: str) -> Run | None:
        """A run that was made here, deleted or not."""
        return self._runs.get(key)

    def open(self, key: str, name: str, tags: Mapping[str, str], start: int | None = None) -> Run:
        """A run that was made here before, or is made now."""
        run = self._runs.get(key)
        if run is None:
            known = [each.data.tags for each in self._runs.values()]
            colours = {each.get("condition", ""): each.get(entries.COLOUR, "") for each in known}
            colour = entries.colour(tags["condition"], colours)
            ours = {KEY: key, entries.COLOUR: colour, "mlflow.source.name": "juicer", "mlflow.source.type": "LOCAL"}
            run = self._client.create_run(self.experiment, start_time=start, tags={**ours, **tags}, run_name=name)
            self._runs[key] = run
        return run

    def show(self, models: Sequence[Model]) -> list[str]:
        """Show all models of the study, the oldest first; gives a sentence for each that cannot be shown."""
        problems: list[str] = []

        def attempt(label: str, action: Callable[[], None]) -> bool:
            try:
                action()
            except Exception as error:
                self._client.search_experiments(max_results=1)  # raises if MLflow is away
                problems.append(f"MLflow does not show {label} of '{models[0].study}': {reason(error)}")
                return False
            return True

        # Of conditions that are called alike, made by another configuration or other code, the study is of the newest.
        newest = {model.condition: model.parent_key for model in models}
        is_shown = {model.key: attempt(model.label, partial(self._show_model, model)) for model in models}
        # In an order that does not depend on which was finished first.
        ordered = sorted(models, key=lambda model: (model.condition, model.parent_key, model.seed))
        shown = [model for model in ordered if is_shown[model.key]]
        hosts = {model.report: model for model in reversed(shown)}
        for parent in dict.fromkeys(model.parent_key for model in shown):
            same = [model for model in shown if model.parent_key == parent]
            attempt(same[0].title, partial(self._show_condition, same, hosts[same[0].report]))
        if told := [model for model in shown if model.parent_key == newest[model.condition]]:
            reports = [model.report for model in models if is_shown[model.key] and model.report]
            attempt("the comparison", partial(self._describe, told, hosts[reports[-1]] if reports else told[0]))
        return problems

    def _show_model(self, model: Model) -> None:
        state = " ".join(model.evaluations.values())
        if (found := self.find(model.key)) and _is_done(found, state):
            self._link_pages(found, model)
            return
        history = self._history(model)
        end = _time(history.evaluation)
        tags = {"condition": model.condition, "seed": str(model.seed)}
        run = self.open(model.key, model.label, tags, end - round(1000 * history.seconds))
        self._log_params(run, model.params)
        self._log_numbers(run, _facts(history), end)
        for name, ref in model.shifted.items():
            measured = entries.outcome(self._store.manifest(ArtifactRef.parse(ref)))
            self._log_numbers(run, {f"under_{name}/{fact}": value for fact, value in measured.items()}, end)
        self._log_curves(run, history)
        self._log_datasets(run, history)
        identity = run.info.run_id
        rows = read_evaluation(self._store.open(history.evaluation.ref, "evaluation"))
        self._client.log_text(identity, entries.table(rows), "evaluation.json")
        page = lineage_page(f"{model.label}: what it was made from", history.known, _names(model, history))
        self._client.log_text(identity, page, "lineage.html")
        if history.checkpoint:
            self._log_checkpoint(run, model, history, history.checkpoint)
        note = self._story(run, model, self._pages)
        parent = self.open(model.parent_key, model.title, {"condition": model.condition}, run.info.start_time)
        tags = {NOTE: note, "mlflow.parentRunId": parent.info.run_id, "mlflow.loggedArtifacts": entries.LOGGED_TABLE}
        tags |= entries.sight(model, history.evaluation) | ({PAGES: self._pages} if self._pages else {})
        if commit := entries.commit(history.evaluation):
            tags["mlflow.source.git.commit"] = commit
        self._complete(run, state, end, tags)

    def _history(self, model: Model) -> History:
        """What a model was made from; only read for what MLflow does not show yet, as that takes a while."""
        if model.key not in self._histories:
            self._histories[model.key] = read_history(self._store, ArtifactRef.parse(model.evaluation))
        return self._histories[model.key]

    def _story(self, run: Run, model: Model, pages: str) -> str:
        return entries.story(self.experiment, run.info.run_id, self._history(model), model.finding, pages)

    def _link_pages(self, run: Run, model: Model) -> None:
        """Have the note of a complete run link to the pages where they are now, unless somebody has changed it."""
        linked, note = run.data.tags.get(PAGES, ""), run.data.tags.get(NOTE)
        if self._pages and self._pages != linked and note == self._story(run, model, linked):
            self._client.set_tag(run.info.run_id, NOTE, self._story(run, model, self._pages))
            self._client.set_tag(run.info.run_id, PAGES, self._pages)

    def _show_condition(self, models: Sequence[Model], host: Model) -> None:
        first = models[0]
        made = [" ".join([*model.evaluations.values(), model.report]) for model in models]
        state = hashlib.sha256(" ".join(made).encode()).hexdigest()
        if (found := self.find(first.parent_key)) and _is_done(found, state):
            return
        histories = {model.key: self._history(model) for model in models}
        end = max(_time(history.evaluation) for history in histories.values())
        start = min(run.info.start_time for model in models if (run := self.find(model.key)))
        run = self.open(first.parent_key, first.title, {"condition": first.condition}, start)
        (result,) = self._results(models)
        params = {key: value for key, value in first.params.items() if key.rpartition(".")[2] != "seed"}
        self._log_params(run, params)
        self._log_numbers(run, entries.rates(result), end)
        known: dict[ArtifactRef, Manifest | None] = {}
        names: dict[ArtifactRef, str] = {}
        for model in models:
            self._log_datasets(run, histories[model.key])
            known |= histories[model.key].known
            names |= _names(model, histories[model.key])
        page = lineage_page(f"{first.title}: what its models were made from", known, names)
        self._client.log_text(run.info.run_id, page, "lineage.html")
        self._client.log_text(run.info.run_id, markdown_table([result]), "comparison.md")
        if first.report and host.parent_key == first.parent_key:
            folder = self._store.open(ArtifactRef.parse(first.report), "report")
            self._client.log_artifacts(run.info.run_id, str(folder), "report")
        self._complete(run, state, end, {NOTE: f"{markdown_table([result])}\n{self._report_link(host)}"})

    def _describe(self, models: Sequence[Model], host: Model) -> None:
        """Tell on the experiment's page what came out, and what to look at; a note that somebody changed is kept."""
        kept, stamp, told = self._tags.get(NOTE, ""), "juicer.note", "juicer.told"
        state = entries.digest("".join(model.model_dump_json(exclude={"params"}) for model in (host, *models)))
        if kept and (entries.digest(kept) != self._tags.get(stamp) or self._tags.get(told) == state):
            return
        results = self._results(models)
        note = entries.guide(results, markdown_table(results), self._report_link(host), self.experiment)
        for key, value in {NOTE: note, stamp: entries.digest(note), told: state, **entries.views()}.items():
            self._client.set_experiment_tag(self.experiment, key, value)
            self._tags = {**self._tags, key: value}

    def _report_link(self, host: Model) -> str:
        run = self.find(host.parent_key) if host.report else None
        return entries.report_link(self.experiment, run.info.run_id) if run else ""

    def _results(self, models: Sequence[Model]) -> list[ConditionResult]:
        entries_of = [(model, name, ref) for model in models for name, ref in model.evaluations.items()]
        rows = [
            ReportRow(
                condition=model.condition, title=model.title, seed=model.seed, shift=name, unnoticed=model.unnoticed
            )
            for model, name, _ in entries_of
        ]
        return condition_results(self._store, [ArtifactRef.parse(ref) for _, _, ref in entries_of], rows)

    def _log_params(self, run: Run, params: Mapping[str, object]) -> None:
        missing = [Param(name, entries.value(item)) for name, item in params.items() if name not in run.data.params]
        for batch in _batches(missing, PARAMS_BATCH):
            self._client.log_batch(run.info.run_id, params=batch)

    def _log_numbers(self, run: Run, numbers: Mapping[str, float], time: int) -> None:
        known = run.data.metrics
        missing = [Metric(name, value, time, 0) for name, value in numbers.items() if known.get(name) != value]
        for batch in _batches(missing, BATCH):
            self._client.log_batch(run.info.run_id, metrics=batch)

    def _log_curves(self, run: Run, history: History) -> None:
        for ref, prefix in history.rounds.items():
            manifest = history.known[ref]
            if ref.kind != "checkpoint" or manifest is None:
                continue
            for name, (steps, values) in read_curves(self._store.open(ref)).items():
                curve = f"{prefix}{name}"
                is_begun = curve in run.data.metrics
                known = self._client.get_metric_history(run.info.run_id, curve) if is_begun else ()
                points = dict(zip(steps, values, strict=True))
                for point in known:
                    points.pop(point.step, None)
                time = _time(manifest)
                missing = [Metric(curve, value, time, step) for step, value in points.items()]
                for batch in _batches(missing, BATCH):
                    self._client.log_batch(run.info.run_id, metrics=batch)

    def _log_datasets(self, run: Run, history: History) -> None:
        inputs: list[DatasetInput] = [
            entries.dataset(manifest)
            for ref, manifest in history.known.items()
            if manifest and ref.kind not in ("checkpoint", "evaluation", "report")
        ]
        if inputs:
            self._client.log_inputs(run.info.run_id, inputs)

    def _log_checkpoint(self, run: Run, model: Model, history: History, ref: ArtifactRef) -> None:
        identity, name = run.info.run_id, f"{model.study}.{model.condition}"
        self._client.log_artifacts(identity, str(self._store.open(ref, "checkpoint")), entries.MODEL)
        self._client.log_text(identity, entries.mlmodel(identity, model.task), f"{entries.MODEL}/MLmodel")
        try:
            self._client.create_registered_model(name, description=f"{model.title} of the study '{model.study}'.")
        except MlflowException as error:
            if error.error_code != ErrorCode.Name(RESOURCE_ALREADY_EXISTS):
                raise
        versions = list(self._client.search_model_versions(f"name = '{name}'", max_results=10_000))
        if not any(version.run_id == identity and version.tags.get("artifact") == str(ref) for version in versions):
            source, tags = f"runs:/{identity}/{entries.MODEL}", entries.version_tags(model, history, ref)
            note = entries.loading(name, model.task, history.evaluation.observes or STATE)
            versions.append(self._client.create_model_version(name, source, identity, tags=tags, description=note))
        self._client.set_registered_model_alias(name, "last", max(versions, key=lambda each: int(each.version)).version)
        rated = [version for version in versions if "success_rate" in version.tags]
        best = max(rated, key=lambda each: (float(each.tags["success_rate"]), -int(each.version)))
        self._client.set_registered_model_alias(name, "best", best.version)

    def _complete(self, run: Run, state: str, end: int, tags: Mapping[str, str]) -> None:
        self._client.set_terminated(run.info.run_id, "FINISHED", end)
        self._client.log_batch(run.info.run_id, tags=[RunTag(key, value) for key, value in tags.items()])
        self._client.set_tag(run.info.run_id, COMPLETE, state)

    def _search(self) -> Iterator[Run]:
        for view in (ViewType.DELETED_ONLY, ViewType.ACTIVE_ONLY):
            token: str | None = ""
            while token is not None:
                page = self._client.search_runs(
                    [self.experiment], f"tags.`{KEY}` != ''", view, max_results=BATCH, page_token=token or None
                )
                yield from page
                token = page.token or None


def _location(client: MlflowClient, name: str) -> str | None:
    """Where files of an experiment go whose place was not given."""
    if not client.tracking_uri.startswith("sqlite"):
        return None
    # MLflow would take the working directory.
    return f"{client.get_experiment('0').artifact_location.rpartition('/')[0]}/{name}"


def _is_done(run: Run, state: str) -> bool:
    """Whether a run shows everything; nothing more is to be shown in one that was deleted."""
    return run.info.lifecycle_stage == LifecycleStage.DELETED or run.data.tags.get(COMPLETE) == state


def _names(model: Model, history: History) -> dict[ArtifactRef, str]:
    """What the models behind an evaluation, and itself, are called."""
    return {
        ref: f"{model.label} {prefix.replace('_', ' ').strip('/')}".strip()
        for ref, prefix in history.rounds.items()
        if ref.kind in ("checkpoint", "evaluation")
    }


def _facts(history: History) -> dict[str, float]:
    """Numbers by name; those of the final model's evaluation have the same names whatever its condition."""
    numbers = entries.outcome(history.evaluation)
    for ref, prefix in history.rounds.items():
        if manifest := history.known[ref]:
            stage = manifest.recipe.stage
            numbers |= {f"{prefix}{stage}/{key}": number for key, number in entries.flat_numbers(manifest.summary)}
            numbers[f"{prefix}{stage}/seconds"] = manifest.seconds
    return numbers


def _time(manifest: Manifest) -> int:
    """When an artifact was finished, as MLflow counts."""
    return round(1000 * datetime.fromisoformat(manifest.finished).timestamp())


def _batches(items: Sequence[Any], size: int) -> Iterator[Sequence[Any]]:
    for start in range(0, len(items), size):
        yield items[start : start + size]
