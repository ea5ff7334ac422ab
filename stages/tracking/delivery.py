"""Journals become MLflow runs. The only module that talks to MLflow.

Delivering an event twice changes nothing, so a kill between a delivery and the note of it does no harm.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from mlflow import MlflowClient
from mlflow.entities import Dataset, DatasetInput, InputTag, Metric, Param, RunTag
from mlflow.exceptions import MlflowException, RestException
from mlflow.protos.databricks_pb2 import RESOURCE_ALREADY_EXISTS, ErrorCode
from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore
from sqlalchemy.engine import make_url

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError
from juicer.reporting.lineage import label_of, lineage_nodes
from juicer.reporting.lineage_drawing import lineage_graph
from juicer.storage.curves import read_curves
from juicer.storage.evaluations import read_evaluation
from stages.tracking.journal import END, MADE, METRICS, RESULT, RESUMED, RUN, DeliveryState, Entry
from stages.tracking.record import DATA_KINDS

BATCH = 1000
LONGEST_VALUE = 500
"""Letters of a parameter that MLflow's interface can still show."""

NESTED_FACTS = (
    "milestones",
    "outcomes",
    "episodes",
    "timesteps",
    "windows",
    "validation_windows",
    "unused_episodes",
    "unused_timesteps",
)
"""Tables within a summary that are shown number by number."""


class Delivery:
    """Delivers events to one MLflow database or server."""

    def __init__(self, uri: str, artifact_root: Path | None, store: ArtifactStore) -> None:
        """Connect, and create the database if it is missing.

        Args:
            uri: Tracking address.
            artifact_root: Where the files of new experiments go; the server decides if None.
            store: Where the artifacts that the journals name are.
        """
        _create_database(uri, artifact_root)
        # Models go where the runs go, whatever MLFLOW_REGISTRY_URI says.
        self._client = MlflowClient(uri, registry_uri=uri)
        self._artifact_root = artifact_root
        self._store = store

    def ping(self) -> None:
        """Reach the database."""
        self._client.search_experiments(max_results=1)

    def deliver(
        self, entries: Sequence[Entry], state: DeliveryState, parent: DeliveryState | None
    ) -> Iterator[DeliveryState]:
        """Deliver events in order; yields the state after each step that need not be repeated."""
        pending: list[Metric] = []
        for entry in entries:
            event = entry.content
            if event["event"] == METRICS:
                pending += _metrics(event)
            else:
                self._flush(state, pending)
                self._deliver(event, state, parent)
            state.offset = entry.end
            if len(pending) >= BATCH or not pending:
                self._flush(state, pending)
                yield state
        self._flush(state, pending)
        yield state

    def _deliver(self, event: Mapping[str, Any], state: DeliveryState, parent: DeliveryState | None) -> None:
        if event["event"] == RUN:
            self._create(event, state, parent)
        elif event["event"] == MADE:
            try:
                self._show(event, self._store.manifest(ArtifactRef.parse(event["ref"])), state)
            except ArtifactError as error:
                self._client.set_tag(
                    state.run_id, f"missing.{event['ref'].replace('/', '.')}", str(error)[:LONGEST_VALUE]
                )
        elif event["event"] == RESULT:
            self._log_numbers(state, "", event["metrics"], event["time"])
            if event["table"]:
                self._client.log_text(state.run_id, event["table"], "comparison.md")
        elif event["event"] == RESUMED:
            self._client.update_run(state.run_id, status="RUNNING")
        elif event["event"] == END:
            self._client.set_terminated(state.run_id, event["status"], event["time"])

    def _create(self, event: Mapping[str, Any], state: DeliveryState, parent: DeliveryState | None) -> None:
        if not state.run_id:
            state.experiment_id = self._experiment(event["experiment"])
            tags = {"mlflow.source.name": "juicer", "mlflow.source.type": "LOCAL", **event["tags"]}
            if parent and parent.run_id:
                tags["mlflow.parentRunId"] = parent.run_id
            run = self._client.create_run(
                state.experiment_id, start_time=event["time"], tags=tags, run_name=event["name"]
            )
            state.run_id = run.info.run_id
        params = [Param(name, str(value)[:LONGEST_VALUE]) for name, value in event["params"].items()]
        for start in range(0, len(params), 100):
            self._client.log_batch(state.run_id, params=params[start : start + 100])

    def _experiment(self, name: str) -> str:
        found = self._client.get_experiment_by_name(name)
        if found:
            return str(found.experiment_id)
        location = None if self._artifact_root is None else (self._artifact_root / name).as_uri()
        tags = {"mlflow.experimentKind": "custom_model_development"}  # else it opens as one about language models
        return str(self._client.create_experiment(name, artifact_location=location, tags=tags))

    def _show(self, event: Mapping[str, Any], manifest: Manifest, state: DeliveryState) -> None:
        ref, prefix, stage = manifest.ref, event["prefix"], event["stage"]
        numbers = {f"{stage}/{name}": value for name, value in _flat_numbers(manifest.summary)}
        self._log_numbers(state, prefix, numbers, event["time"])
        self._client.log_batch(state.run_id, tags=[RunTag(f"artifact.{prefix.replace('/', '.')}{stage}", str(ref))])
        if ref.kind in DATA_KINDS:
            self._client.log_inputs(state.run_id, [_dataset(manifest, self._store.url)])
        elif ref.kind == "checkpoint":
            self._show_checkpoint(event, manifest, state)
        elif ref.kind == "evaluation":
            rows = read_evaluation(self._store.open(ref))
            table = {
                "seed": [row.seed for row in rows],
                "outcome": [row.outcome.value for row in rows],
                "parts_assembled": [row.parts_assembled for row in rows],
                "steps": [row.length for row in rows],
                "milestones": [", ".join(row.milestones) for row in rows],
            }
            self._client.log_table(state.run_id, table, f"{prefix}evaluation-{ref.id}.json")
            self._log_numbers(state, prefix, {"success_rate": manifest.summary["success_rate"]}, event["time"])
            self._log_lineage(ref, state)
        elif ref.kind == "report":
            self._client.log_artifacts(state.run_id, str(self._store.open(ref)), "report")

    def _show_checkpoint(self, event: Mapping[str, Any], manifest: Manifest, state: DeliveryState) -> None:
        ref, prefix, time = manifest.ref, event["prefix"], event["time"]
        folder, place = self._store.open(ref), f"{prefix}checkpoint"
        # A checkpoint that was found rather than trained brings its curves along.
        for name, (steps, values) in () if event["live"] else read_curves(folder).items():
            points = [Metric(f"{prefix}{name}", value, time, step) for step, value in zip(steps, values, strict=True)]
            for start in range(0, len(points), BATCH):
                self._client.log_batch(state.run_id, metrics=points[start : start + BATCH])
        self._client.log_artifacts(state.run_id, str(folder), place)
        run = self._client.get_run(state.run_id)
        name = run.data.tags.get("juicer.model", "policy")
        self._register(name, ref, place, run.data.tags, state)

    def _register(self, name: str, ref: ArtifactRef, place: str, tags: Mapping[str, str], state: DeliveryState) -> None:
        try:
            self._client.create_registered_model(name, description="Policies trained by juicer.")
        except (MlflowException, RestException) as error:
            if error.error_code != ErrorCode.Name(RESOURCE_ALREADY_EXISTS):
                raise
        versions = self._client.search_model_versions(f"name = '{name}' and run_id = '{state.run_id}'")
        version = next((entry for entry in versions if entry.tags.get("artifact") == str(ref)), None)
        if version is None:
            version = self._client.create_model_version(
                name,
                source=f"runs:/{state.run_id}/{place}",
                run_id=state.run_id,
                tags={"artifact": str(ref), **{key: tags[key] for key in ("condition", "seed") if key in tags}},
                description=_story(self._store, ref),
            )
        if alias := tags.get("juicer.alias"):
            self._client.set_registered_model_alias(name, alias, version.version)

    def _log_lineage(self, ref: ArtifactRef, state: DeliveryState) -> None:
        graph = lineage_graph(list(lineage_nodes(self._store, [ref])))
        page = f"<!doctype html><meta charset='utf-8'><title>Lineage of {ref}</title>{graph}"
        self._client.log_text(state.run_id, page, "lineage.html")
        self._client.set_tag(state.run_id, "mlflow.note.content", _story(self._store, ref))

    def _log_numbers(self, state: DeliveryState, prefix: str, numbers: Mapping[str, float], time: int) -> None:
        metrics = [Metric(f"{prefix}{name}", float(value), time, 0) for name, value in numbers.items()]
        if metrics:
            self._client.log_batch(state.run_id, metrics=metrics)

    def _flush(self, state: DeliveryState, pending: list[Metric]) -> None:
        for start in range(0, len(pending), BATCH):
            self._client.log_batch(state.run_id, metrics=pending[start : start + BATCH])
        pending.clear()


def _metrics(event: Mapping[str, Any]) -> list[Metric]:
    return [Metric(name, value, event["time"], event["step"]) for name, value in event["metrics"].items()]


def _flat_numbers(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    for key, value in content.items():
        if isinstance(value, Mapping) and key in NESTED_FACTS:
            yield from _flat_numbers(value, f"{prefix}{key}/")
        elif isinstance(value, int | float) and "/" not in key:  # the others are the ends of curves
            yield (
                "".join(letter if letter.isalnum() or letter in "/_-. " else "_" for letter in f"{prefix}{key}"),
                value,
            )


def _create_database(uri: str, artifact_root: Path | None) -> None:
    """Create a missing SQLite database under another name first.

    Its tables are made by dozens of migrations, which SQLite does not undo: a process that is killed among them would
    leave a database that no later one can use.
    """
    url = make_url(uri) if uri.startswith("sqlite") else None
    if not url or not url.database or Path(url.database).exists():
        return
    path = Path(url.database)
    draft = path.with_name(f"{path.name}.draft")
    draft.unlink(missing_ok=True)
    # The experiment that is always there must not keep its files in the working directory.
    root = (artifact_root or path.parent / "mlflow-files").absolute().as_uri()
    address = url.set(database=str(draft)).render_as_string(hide_password=False)
    SqlAlchemyStore(address, root)  # type: ignore[no-untyped-call]  # MLflow's own
    draft.replace(path)


def _dataset(manifest: Manifest, store_url: str) -> DatasetInput:
    recipe = manifest.recipe
    story = {
        "made_by": f"stage {recipe.stage}",
        "made_from": ", ".join(map(str, recipe.parents)) or f"{len(recipe.files)} files",
        "lineage": f"juicer lineage {manifest.ref.id}",
    }
    dataset = Dataset(
        name=f"{recipe.stage}: {manifest.ref.kind}",
        digest=manifest.ref.id,
        source_type="juicer",
        source=json.dumps({"artifact": str(manifest.ref), "store": store_url}),
        profile=json.dumps(story | dict(manifest.summary)),
    )
    return DatasetInput(dataset, [InputTag("mlflow.data.context", recipe.stage)])


def _story(store: ArtifactStore, ref: ArtifactRef) -> str:
    """Markdown table of everything an artifact was made from, and of itself."""
    lines = [
        f"What `{ref}` was made from (the drawing is `lineage.html` among the run's artifacts; "
        f"`juicer lineage {ref.id}` prints it):",
        "",
        "| artifact | made by | from | facts |",
        "|---|---|---|---|",
    ]
    for each in (*store.lineage(ref), ref):
        try:
            manifest = store.manifest(each)
        except ArtifactError:
            lines.append(f"| `{each}` | | | no longer there |")
            continue
        files = [f"{len(manifest.recipe.files)} files"] if manifest.recipe.files else []
        parents = ", ".join([f"`{parent}`" for parent in manifest.recipe.parents] + files)
        lines.append(f"| `{each}` | {manifest.recipe.stage} | {parents} | {label_of(manifest)} |")
    return "\n".join(lines) + "\n"
