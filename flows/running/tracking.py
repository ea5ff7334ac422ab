"""What MLflow is told about a run: which models it makes, and their curves while they are made."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any

from flows.conditions import METHODS, Condition
from flows.config import RunConfig
from flows.loop import ModelOutcome
from juicer.artifacts.code_version import code_version
from juicer.artifacts.ref import ArtifactRef
from juicer.config import canonical_json
from juicer.progress import MetricSink
from stages.runtime.names import STAGES
from stages.tracking.model import Model
from stages.tracking.recorder import Recorder

_NOT_IDENTITY = {"condition", "conditions", "seed", "seeds", "flow", "logs", "labels"}
_SHARED_PARAMS = ("task", "randomness", "record", "ingest", "annotate", "augment", "collect", "select", "evaluate")


class Tracking:
    """The records of one run of a flow."""

    def __init__(self, recorder: Recorder, config: RunConfig) -> None:
        """Describe the models of a run to a recorder."""
        self._recorder = recorder
        self._config = config
        content = config.model_dump(mode="json", exclude=_NOT_IDENTITY)
        code = {name: code_version(f"stages.{name}") for name in STAGES}
        self._identity = hashlib.sha256(canonical_json({"config": content, "code": code}).encode()).hexdigest()[:16]
        self._finished: list[Model] = []

    def model(self, condition: Condition, seed: int) -> LiveModel:
        """Record of one model while it is made."""
        rounds = self._config.rounds if METHODS[condition].collects else 0
        return LiveModel(self._recorder, self._describe(condition, seed), rounds)

    def finish(self, outcome: ModelOutcome) -> None:
        """A model is done, whatever becomes of the others."""
        model = self._describe(outcome.condition, outcome.seed)
        model = model.model_copy(update={"evaluation": str(outcome.evaluation), "finding": outcome.finding})
        self._finished.append(model)
        self._recorder.note(model)

    def conclude(self, report: ArtifactRef) -> None:
        """The page about all models is there."""
        for model in self._finished:
            self._recorder.note(model.model_copy(update={"report": str(report)}))

    def _describe(self, condition: Condition, seed: int) -> Model:
        config, method = self._config, METHODS[condition]
        # As the stages get them: with the task and the randomness that a section leaves to the top level.
        sections = {
            "record": config.recording,
            "ingest": config.ingestion,
            "collect": config.collection(seed=0, round_index=1),
            "evaluate": config.evaluation,
            **({} if method.replays else {"train": config.final_training(condition, seed)}),
        }
        content = config.model_dump(mode="json", include=set(_SHARED_PARAMS))
        content |= {name: section.model_dump(mode="json") for name, section in sections.items()}
        return Model(
            study=config.name,
            identity=self._identity,
            condition=condition.value,
            title=method.title,
            seed=seed,
            task=config.task,
            params={"condition": condition.value, "seed": seed, **dict(_flat(content))},
        )


class LiveModel:
    """Passes on the curves of a model that is being made; the final model's have the plain names."""

    def __init__(self, recorder: Recorder, model: Model, rounds: int, turn: int = 0) -> None:
        """Record a model that is trained again ``rounds`` times, after ``turn`` of them."""
        self._recorder, self._model, self._rounds, self._turn = recorder, model, rounds, turn

    def metrics(self, stage: str) -> MetricSink:
        """Where the curves of a stage go while it runs."""
        return self

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        """Show numbers at a step."""
        prefix = "" if self._turn == self._rounds else f"round_{self._turn + 1}/"
        self._recorder.log(self._model, {f"{prefix}{name}": number for name, number in metrics.items()}, step)

    def for_round(self, turn: int) -> LiveModel:
        """The record of one turn of collect, select, train."""
        return LiveModel(self._recorder, self._model, self._rounds, turn)


def _flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
