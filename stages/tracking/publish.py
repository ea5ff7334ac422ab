"""Show models in MLflow: what is there already is left alone, what is missing is computed from artifacts.

A run is found by a tag, and another tells that it is complete. Publishing twice, after a kill or from a copy of the
data folder therefore changes nothing, and an empty MLflow is filled again. What was deleted in MLflow stays so.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from mlflow import MlflowClient
from mlflow.entities import LifecycleStage, Run, ViewType

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError, TrackingError
from juicer.evaluation import ConditionResult
from juicer.reporting.comparison import ReportRow, condition_results, markdown_table
from juicer.reporting.lineage_page import lineage_page
from juicer.storage.evaluations import read_evaluation
from stages.tracking import entries
from stages.tracking.destination import reason
from stages.tracking.history import History, read_history
from stages.tracking.model import Model
from stages.tracking.run_writer import CHECKPOINT, COMPLETE, RunWriter, finished_at

KEY, PAGES, NOTE = "juicer.model", "juicer.pages", "mlflow.note.content"
RUNS_BATCH = 1000
"""Runs that MLflow gives at a time."""


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
        self._writer = RunWriter(client, store)
        self._name = name
        self._pages = pages
        self._problems: list[str] = []
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

    def open_to_train(self, model: Model, start: int) -> Run:
        """A run for a model that is being trained since some time: another one than that of a finished model."""
        found = self.find(model.key)
        if found and CHECKPOINT in found.data.tags and not _is_deleted(found):
            self._supersede(found, model.key)
        return self.open(model.key, model.label, _tags(model), start)

    def _supersede(self, run: Run, key: str) -> None:
        """Leave a run as it is to the model that it shows, with its versions, since another takes its place."""
        earlier = f"{key} {run.data.tags[CHECKPOINT]}"
        self._client.set_tag(run.info.run_id, KEY, earlier)
        self._client.update_run(run.info.run_id, name=f"{run.info.run_name} (earlier)")
        self._runs[earlier] = self._runs.pop(key)

    def _key_of(self, model: Model, checkpoint: str) -> str:
        """Under which key a model's run is, or is to be made.

        Of several models of one configuration, made from other labels or by other releases of libraries, the newest
        has the plain key.
        """
        found, own = self.find(model.key), f"{model.key} {checkpoint}"
        if found is None:
            return model.key
        shown = found.data.tags.get(CHECKPOINT)
        if shown is None:
            return own if _is_before(model, found) else model.key
        if shown not in ("", checkpoint):
            if self.find(own):
                return own
            self._supersede(found, model.key)
        return model.key

    def _shown(self, model: Model, state: str) -> Run | None:
        """The run that shows a model already, completely."""
        found = self.find(model.key)
        if found and _is_done(found, state):
            return found
        if found and CHECKPOINT not in found.data.tags and not _is_before(model, found):
            return None
        earlier = (run for key, run in self._runs.items() if key.startswith(f"{model.key} "))
        return next((run for run in earlier if run.data.tags.get(COMPLETE) == state), None)

    def show(self, models: Sequence[Model]) -> list[str]:
        """Show all models of the study, the oldest first; gives a sentence for each that cannot be shown."""
        shown = [model for model in models if self._attempt(model.label, partial(self._show_model, model))]
        conditions: dict[str, list[Model]] = {}
        # In an order that does not depend on which was finished first.
        for model in sorted(shown, key=lambda model: (model.condition, model.parent_key, model.seed)):
            conditions.setdefault(model.parent_key, []).append(model)
        reports = {parent: _common_report(same) for parent, same in conditions.items()}
        hosts: dict[str, str] = {}
        for parent, report in reports.items():
            if report and not ((run := self.find(parent)) and _is_deleted(run)):
                hosts.setdefault(report, parent)
        for parent, same in conditions.items():
            report = reports[parent]
            self._attempt(same[0].title, partial(self._show_condition, same, report, hosts.get(report, "")))
        # Of conditions that are called alike, made by another configuration or other code, the study is of the newest.
        newest = {model.condition: model.parent_key for model in shown if model.task == shown[-1].task}
        told = [model for parent in conditions if parent in newest.values() for model in conditions[parent]]
        if told:
            self._attempt("the comparison", partial(self._describe, told, hosts.get(_common_report(told), "")))
        return list(dict.fromkeys(self._problems))

    def _attempt(self, label: str, action: Callable[[], None]) -> bool:
        try:
            action()
        except Exception as error:
            self._client.search_experiments(max_results=1)  # raises if MLflow is away
            self._problems.append(f"MLflow does not show {label} of '{self._name}': {reason(error)}")
            return False
        return True

    def _show_model(self, model: Model) -> None:
        state = " ".join(model.evaluations.values())
        if shown := self._shown(model, state):
            self._link_pages(shown, model)
            return
        history = self._history(model)
        end = finished_at(history.evaluation)
        key = self._key_of(model, str(history.checkpoint or ""))
        run = self.open(key, model.label, _tags(model), end - round(1000 * history.seconds))
        self._writer.params(run, model.params)
        self._writer.numbers(run, _facts(history), end)
        for name, ref in model.shifted.items():
            measured = entries.outcome(self._store.manifest(ArtifactRef.parse(ref)))
            self._writer.numbers(run, {f"under_{name}/{fact}": value for fact, value in measured.items()}, end)
        self._writer.curves(run, history)
        self._writer.datasets(run, history)
        identity = run.info.run_id
        rows = read_evaluation(self._store.open(history.evaluation.ref, "evaluation"))
        self._client.log_text(identity, entries.table(rows), "evaluation.json")
        page = lineage_page(f"{model.label}: what it was made from", history.known, _names(model, history))
        self._client.log_text(identity, page, "lineage.html")
        if history.checkpoint:
            self._writer.checkpoint(run, model, history, history.checkpoint)
        note = self._story(run, model, self._pages)
        parent = self.open(model.parent_key, model.title, {"condition": model.condition}, run.info.start_time)
        tags = {NOTE: note, "mlflow.parentRunId": parent.info.run_id, "mlflow.loggedArtifacts": entries.LOGGED_TABLE}
        tags |= entries.sight(model, history.evaluation) | ({PAGES: self._pages} if self._pages else {})
        if commit := entries.commit(history.evaluation):
            tags["mlflow.source.git.commit"] = commit
        self._writer.complete(run, state, end, tags)

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
        if _is_deleted(run) or not self._pages or self._pages == linked:
            return
        if note == self._story(run, model, linked):
            self._client.set_tag(run.info.run_id, NOTE, self._story(run, model, self._pages))
            self._client.set_tag(run.info.run_id, PAGES, self._pages)

    def _show_condition(self, models: Sequence[Model], report: str, host: str) -> None:
        """Show the averages of models; the report as well, if the run of this condition is where it is kept."""
        first = models[0]
        made = [report, host, *(ref for model in models for ref in model.evaluations.values())]
        state = entries.digest(" ".join(made))
        if (found := self.find(first.parent_key)) and _is_done(found, state):
            return
        models = self._readable(models)
        histories = {model.key: self._history(model) for model in models}
        end = max(finished_at(history.evaluation) for history in histories.values())
        start = min(run.info.start_time for model in models if (run := self.find(model.key)))
        run = self.open(first.parent_key, first.title, {"condition": first.condition}, start)
        (result,) = self._results(models)
        params = {key: value for key, value in first.params.items() if key.rpartition(".")[2] != "seed"}
        self._writer.params(run, params)
        self._writer.numbers(run, entries.rates(result), end)
        known: dict[ArtifactRef, Manifest | None] = {}
        names: dict[ArtifactRef, str] = {}
        for model in models:
            self._writer.datasets(run, histories[model.key])
            known |= histories[model.key].known
            names |= _names(model, histories[model.key])
        page = lineage_page(f"{first.title}: what its models were made from", known, names)
        self._client.log_text(run.info.run_id, page, "lineage.html")
        self._client.log_text(run.info.run_id, markdown_table([result]), "comparison.md")
        if host == first.parent_key:
            folder = self._store.open(ArtifactRef.parse(report), "report")
            self._client.log_artifacts(run.info.run_id, str(folder), "report")
        self._writer.complete(run, state, end, {NOTE: f"{markdown_table([result])}\n{self._report_link(host)}"})

    def _describe(self, models: Sequence[Model], host: str) -> None:
        """Tell on the experiment's page what came out, and what to look at; a note that somebody changed is kept."""
        kept, stamp, told = self._tags.get(NOTE, ""), "juicer.note", "juicer.told"
        link = self._report_link(host)
        shown = [model.model_dump_json(exclude={"params", "noted"}) for model in models]
        state = entries.digest("".join([link, *shown]))
        ours = self._tags.get(stamp, "").split()
        if kept and (entries.digest(kept) not in ours or self._tags.get(told) == state):
            return
        results = self._results(self._readable(models))
        note = entries.guide(results, markdown_table(results), link, self.experiment)
        # Whichever of the two a kill leaves is known as ours, and what was told comes last.
        stamps = f"{entries.digest(kept)} {entries.digest(note)}"
        for key, value in {**entries.views(), stamp: stamps, NOTE: note, told: state}.items():
            self._client.set_experiment_tag(self.experiment, key, value)

    def _report_link(self, host: str) -> str:
        run = self.find(host)
        return entries.report_link(self.experiment, run.info.run_id) if run else ""

    def _readable(self, models: Sequence[Model]) -> list[Model]:
        """Those whose evaluation is still in the store; of the others it is told that they do not count.

        Raises:
            ArtifactError: If there is none.
        """
        readable, lost = [], None
        for model in models:
            try:
                self._store.manifest(ArtifactRef.parse(model.evaluation))
                readable.append(model)
            except ArtifactError as error:
                lost = error
                self._problems.append(
                    f"{model.label} of '{self._name}' does not count in MLflow's averages any more: {reason(error)}"
                )
        if lost and not readable:
            raise lost
        return readable

    def _results(self, models: Sequence[Model]) -> list[ConditionResult]:
        entries_of = [(model, name, ref) for model in models for name, ref in model.evaluations.items()]
        rows = [
            ReportRow(
                condition=model.condition, title=model.title, seed=model.seed, shift=name, unnoticed=model.unnoticed
            )
            for model, name, _ in entries_of
        ]
        return condition_results(self._store, [ArtifactRef.parse(ref) for _, _, ref in entries_of], rows)

    def _search(self) -> Iterator[Run]:
        for view in (ViewType.DELETED_ONLY, ViewType.ACTIVE_ONLY):
            token: str | None = ""
            while token is not None:
                page = self._client.search_runs(
                    [self.experiment], f"tags.`{KEY}` != ''", view, max_results=RUNS_BATCH, page_token=token or None
                )
                yield from page
                token = page.token or None


def _location(client: MlflowClient, name: str) -> str | None:
    """Where files of an experiment go whose place was not given."""
    if not client.tracking_uri.startswith("sqlite"):
        return None
    # MLflow would take the working directory.
    return f"{client.get_experiment('0').artifact_location.rpartition('/')[0]}/{name}"


def _is_deleted(run: Run) -> bool:
    return bool(run.info.lifecycle_stage == LifecycleStage.DELETED)


def _tags(model: Model) -> dict[str, str]:
    return {"condition": model.condition, "seed": str(model.seed)}


def _is_before(model: Model, run: Run) -> bool:
    """Whether a model was finished before the training began that a run without a checkpoint shows."""
    return bool(1000 * model.noted < run.info.start_time)


def _is_done(run: Run, state: str) -> bool:
    """Whether a run shows everything; nothing more is to be shown in one that was deleted."""
    return _is_deleted(run) or run.data.tags.get(COMPLETE) == state


def _common_report(models: Iterable[Model]) -> str:
    """The report that most of the models are in, of several the newest; empty if they are in none."""
    reports = Counter(model.report for model in sorted(models, key=lambda model: -model.noted) if model.report)
    return next((report for report, _ in reports.most_common(1)), "")


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
