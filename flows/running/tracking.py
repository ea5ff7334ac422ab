"""What MLflow is told about a run: which models it makes, and their curves while they are made."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any

from flows.conditions import WORDS
from flows.config import MIX_KEY, RunConfig
from flows.loop import ModelOutcome
from flows.loop_config import DATA_KEYS, LoopConfig
from flows.written import PATH_KEYS
from juicer.artifacts.code_version import code_version
from juicer.artifacts.ref import ArtifactRef
from juicer.config import canonical_json
from juicer.progress import MetricSink
from stages.runtime.names import STAGES
from stages.tracking.model import Model
from stages.tracking.recorder import Recorder

_IDENTITY = LoopConfig.model_fields.keys() - {*PATH_KEYS, "analyses", "shifts", MIX_KEY}
"""Keys that make a model another one: those of its loop, without paths and what is measured of it."""
_ABOUT_MODELS = {"modes", "monitor", "report", "sampling"}
"""Stages that no model is made or measured by: a report that is worded otherwise is of the same models."""
_SHARED_PARAMS = {"task", *DATA_KEYS, "evaluate", "shifts"}


class Tracking:
    """The records of one run of a flow."""

    def __init__(self, recorder: Recorder, config: RunConfig) -> None:
        """Describe the models of a run to a recorder."""
        self._recorder = recorder
        self._config = config
        self._code = {name: code_version(f"stages.{name}") for name in STAGES if name not in _ABOUT_MODELS}
        self._finished: dict[str, Model] = {}

    def model(self, condition: str, seed: int) -> LiveModel:
        """Record of one model while it is made."""
        rounds = self._config.loop(condition).turns(self._config.method(condition))
        return LiveModel(self._recorder, self._describe(condition, seed), rounds)

    def finish(self, outcome: ModelOutcome) -> None:
        """A model is done, whatever becomes of the others; what is known of it already is not told again."""
        model = self._describe(outcome.condition, outcome.seed)
        update = {
            "title": outcome.title,
            "finding": outcome.finding,
            "evaluation": str(outcome.evaluation),
            "shifted": {name: str(ref) for name, ref in outcome.shifted.items() if ref},
            "unnoticed": tuple(name for name, ref in outcome.shifted.items() if ref is None),
        }
        model = model.model_copy(update=update)
        if self._finished.get(model.key) != model:
            self._finished[model.key] = model
            self._recorder.note(model)

    def conclude(self, report: ArtifactRef) -> None:
        """The page about all models is there."""
        for model in self._finished.values():
            self._recorder.note(model.model_copy(update={"report": str(report)}))

    def _describe(self, condition: str, seed: int) -> Model:
        config, method = self._config.loop(condition), self._config.method(condition)
        # As the stages get them: with the task and the randomness that a section leaves to the top level.
        sections = {
            "record": config.recording,
            "ingest": config.ingestion,
            "collect": config.collection(seed=0, round_index=1),
            "correct": config.correction,
            "evaluate": config.evaluation,
            **({} if method.replay else {"train": config.final_training(method, seed)}),
        }
        content = config.model_dump(mode="json", include=_SHARED_PARAMS)
        content |= {name: section.model_dump(mode="json") for name, section in sections.items()}
        return Model(
            study=config.name,
            identity=self._identity_of(condition),
            condition=condition,
            title=method.title,
            seed=seed,
            task=config.task,
            params={"condition": condition, "seed": seed, **dict(_flat(content))},
        )

    def _identity_of(self, condition: str) -> str:
        """What tells a condition from one that had the same name in another configuration."""
        method, loop = self._config.method(condition), self._config.loop(condition)
        loops = (loop, *(loop.mix.values() if method.joint_policy else ()))
        content = {
            # What a condition changes is in its loop, and counts there like what the top level says.
            "made of": method.model_dump(mode="json", exclude={*WORDS, "changes"}),
            "config": [each.model_dump(mode="json", include=_IDENTITY) for each in loops],
            "code": self._code,
        }
        return hashlib.sha256(canonical_json(content).encode()).hexdigest()[:16]


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
