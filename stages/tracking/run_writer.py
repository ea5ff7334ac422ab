"""Write into a run of MLflow what it does not show yet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import Any

from mlflow import MlflowClient
from mlflow.entities import DatasetInput, Metric, Param, Run, RunTag
from mlflow.exceptions import MlflowException
from mlflow.protos.databricks_pb2 import RESOURCE_ALREADY_EXISTS, ErrorCode

from juicer.artifacts.manifest import STATE, Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.storage.curves import read_curves
from stages.tracking import entries
from stages.tracking.history import History
from stages.tracking.model import Model

COMPLETE = "juicer.complete"
"""Tag of a run that shows everything; its value says of what."""
CHECKPOINT = "juicer.checkpoint"
"""Tag of a run that shows a finished model; its value says which, as ``kind/id``."""
BATCH, PARAMS_BATCH = 1000, 100
"""Entries that MLflow takes at a time."""


class RunWriter:
    """Adds to runs what is missing in them, so that what a kill left half done is completed."""

    def __init__(self, client: MlflowClient, store: ArtifactStore) -> None:
        """Write through a client what lies in a store."""
        self._client = client
        self._store = store

    def params(self, run: Run, params: Mapping[str, object]) -> None:
        """Parameters; those that a run has stay as they are, as MLflow refuses another value."""
        missing = [Param(name, entries.value(item)) for name, item in params.items() if name not in run.data.params]
        for batch in _batches(missing, PARAMS_BATCH):
            self._client.log_batch(run.info.run_id, params=batch)

    def numbers(self, run: Run, numbers: Mapping[str, float], time: int) -> None:
        """Metrics of one value each, at a time in milliseconds, or later if there is another value of that time."""
        known = run.data.metrics
        changed = {name: value for name, value in numbers.items() if known.get(name) != value}
        missing = [Metric(name, value, self._time_after(run, name, time), 0) for name, value in changed.items()]
        for batch in _batches(missing, BATCH):
            self._client.log_batch(run.info.run_id, metrics=batch)

    def _time_after(self, run: Run, name: str, time: int) -> int:
        # Of all values at one step, MLflow shows that of the latest time, and of these the largest.
        known = self._client.get_metric_history(run.info.run_id, name) if name in run.data.metrics else ()
        return max([time, *(point.timestamp + 1 for point in known)])

    def curves(self, run: Run, history: History) -> None:
        """How the models of all rounds learned; the final one's curves have the plain names."""
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
                time = finished_at(manifest)
                missing = [Metric(curve, value, time, step) for step, value in points.items()]
                for batch in _batches(missing, BATCH):
                    self._client.log_batch(run.info.run_id, metrics=batch)

    def datasets(self, run: Run, history: History) -> None:
        """What a model was made from."""
        inputs: list[DatasetInput] = [
            entries.dataset(manifest)
            for ref, manifest in history.known.items()
            if manifest and ref.kind not in ("checkpoint", "evaluation", "report")
        ]
        if inputs:
            self._client.log_inputs(run.info.run_id, inputs)

    def checkpoint(self, run: Run, model: Model, history: History, ref: ArtifactRef) -> None:
        """The model itself, as a version of its condition's registered model."""
        identity, name = run.info.run_id, f"{model.study}.{model.condition}"
        self._client.set_tag(identity, CHECKPOINT, str(ref))
        self._client.log_artifacts(identity, str(self._store.open(ref, "checkpoint")), entries.MODEL)
        self._client.log_text(identity, entries.mlmodel(identity, model.task), f"{entries.MODEL}/MLmodel")
        try:
            self._client.create_registered_model(name, description=f"{model.title} of the study '{model.study}'.")
        except MlflowException as error:
            if error.error_code != ErrorCode.Name(RESOURCE_ALREADY_EXISTS):
                raise
        versions = list(self._client.search_model_versions(f"name = '{name}'", max_results=10_000))
        tags = entries.version_tags(model, history, ref)
        known = [each for each in versions if each.run_id == identity and each.tags.get("artifact") == str(ref)]
        for version in known:
            # It may have been evaluated further since.
            for key, text in tags.items():
                if version.tags.get(key) != text:
                    self._client.set_model_version_tag(name, version.version, key, text)
                    version.tags[key] = text
        if not known:
            source = f"runs:/{identity}/{entries.MODEL}"
            note = entries.loading(name, model.task, history.evaluation.observes or STATE)
            versions.append(self._client.create_model_version(name, source, identity, tags=tags, description=note))
        self._client.set_registered_model_alias(name, "last", max(versions, key=lambda each: int(each.version)).version)
        rated = [version for version in versions if "success_rate" in version.tags]
        best = max(rated, key=lambda each: (float(each.tags["success_rate"]), -int(each.version)))
        self._client.set_registered_model_alias(name, "best", best.version)

    def complete(self, run: Run, state: str, end: int, tags: Mapping[str, str]) -> None:
        """Last of all: tags, and that the run shows everything of a state."""
        self._client.set_terminated(run.info.run_id, "FINISHED", end)
        self._client.log_batch(run.info.run_id, tags=[RunTag(key, value) for key, value in tags.items()])
        self._client.set_tag(run.info.run_id, COMPLETE, state)


def finished_at(manifest: Manifest) -> int:
    """When an artifact was finished, as MLflow counts."""
    return round(1000 * datetime.fromisoformat(manifest.finished).timestamp())


def _batches(items: Sequence[Any], size: int) -> Iterator[Sequence[Any]]:
    for start in range(0, len(items), size):
        yield items[start : start + size]
