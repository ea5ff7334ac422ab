"""What MLflow is told about a run: a run for each condition, and below it one for each of its models."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from flows.config import RunConfig
from juicer.artifacts.code_version import code_version
from juicer.evaluation import ConditionResult
from juicer.reporting.comparison import markdown_table
from stages.runtime.names import STAGES
from stages.tracking.journal import FINISHED
from stages.tracking.record import ModelRecord, RunDescription, RunRecord

_NOT_IDENTITY = {"condition", "conditions", "seed", "seeds", "flow", "logs", "labels"}
_SHARED_PARAMS = ("task", "randomness", "record", "ingest", "annotate", "augment", "collect", "select", "evaluate")


class Tracking:
    """The records of one run of a flow."""

    def __init__(self, folder: Path, config: RunConfig) -> None:
        """Open the records below ``folder`` as they are asked for."""
        self._folder = folder
        self._config = config
        content = config.model_dump(mode="json", exclude=_NOT_IDENTITY)
        code = {name: code_version(f"stages.{name}") for name in STAGES}
        self._identity = {"config": content, "code": code}
        self._lock = threading.Lock()
        self._conditions: dict[str, RunRecord] = {}
        self._models: dict[tuple[str, int], RunRecord] = {}

    def model(self, condition: str, seed: int) -> ModelRecord:
        """Record of one model."""
        method = self._config.method(condition)
        training = {} if method.replay else self._config.final_training(method, seed).model_dump(mode="json")
        description = RunDescription(
            experiment=self._config.name,
            name=f"{condition} seed {seed}",
            identity={**self._identity_of(condition), "seed": seed},
            params={**self._params(condition), "seed": seed, **dict(_flat(training, "train."))},
            tags={
                "condition": condition,
                "seed": str(seed),
                "juicer.model": f"{self._config.task}.{condition}",
                "juicer.alias": f"seed-{seed}",
            },
        )
        with self._lock:
            record = RunRecord(self._folder, description, parent=self._condition(condition))
            self._models[condition, seed] = record
        return ModelRecord(record)

    def finish(self, condition: str, seed: int) -> None:
        """The model of a condition and seed is done, whatever becomes of the others."""
        self._models[condition, seed].close(FINISHED)

    def whole(self) -> ModelRecord:
        """Record of what concerns all models: that of the last condition."""
        with self._lock:
            return ModelRecord(self._condition(self._config.chosen[-1]))

    def conclude(self, results: Sequence[ConditionResult]) -> None:
        """Note what the conditions came to."""
        for result in results:
            low, high = result.interval
            metrics = {
                "success_rate": result.average,
                "success_rate_best": result.best,
                "success_rate_low": low,
                "success_rate_high": high,
                "episodes": result.num_episodes,
                "models": result.num_models,
            }
            self._conditions[result.condition].result(metrics, markdown_table(results))

    def close(self, status: str) -> None:
        """End every record; those of finished models, and of conditions with no other, end well in any case."""
        with self._lock:
            for record in self._models.values():
                if record.status != FINISHED:
                    record.close(status)
            for condition, record in self._conditions.items():
                of_models = {model.status for key, model in self._models.items() if key[0] == condition}
                record.close(FINISHED if of_models == {FINISHED} else status)

    def _condition(self, condition: str) -> RunRecord:
        if condition not in self._conditions:
            description = RunDescription(
                experiment=self._config.name,
                name=self._config.method(condition).title,
                identity=self._identity_of(condition),
                params=self._params(condition),
                tags={"condition": condition},
            )
            self._conditions[condition] = RunRecord(self._folder, description)
        return self._conditions[condition]

    def _identity_of(self, condition: str) -> dict[str, Any]:
        """What tells a condition from one that had the same name in another configuration."""
        made_of = self._config.method(condition).model_dump(mode="json", exclude={"title"})
        return {**self._identity, "condition": condition, "made of": made_of}

    def _params(self, condition: str) -> dict[str, Any]:
        config = self._config
        # As the stages get them: with the task and the randomness that a section leaves to the top level.
        of_stages = {
            "record": config.recording,
            "ingest": config.ingestion,
            "collect": config.collection(seed=0, round_index=1),
            "evaluate": config.evaluation,
        }
        content = config.model_dump(mode="json", include=set(_SHARED_PARAMS))
        content |= {name: section.model_dump(mode="json") for name, section in of_stages.items()}
        return {"condition": condition, **dict(_flat(content))}


def _flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
