"""Results of conditions that never ran, and artifacts that no stage has made."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Outcome
from juicer.evaluation import ConditionResult, ModelResult, summarise
from juicer.reporting.comparison import ReportRow
from juicer.reporting.setting import Setting
from juicer.reporting.sources import Sources
from juicer.seeding import stream
from juicer.storage.evaluations import EvaluationRow, write_evaluation
from juicer.study.curves import Curve
from juicer.study.material import Measured, TaskStudy, task_study

Results = Callable[..., ConditionResult]


def make_result(name: str, *rates: float, episodes: int = 100) -> ConditionResult:
    """Models with exactly these rates, whose episodes start from the same states in an order of each one's own."""
    models = []
    for seed, rate in enumerate(rates):
        succeeded = stream(seed, name).permutation(episodes) < round(rate * episodes)
        models.append(ModelResult(seed, tuple(range(episodes)), tuple(map(bool, succeeded))))
    return summarise(name, models, name.upper())


def make_study(*results: ConditionResult, curves: tuple[Curve, ...] = (), settings: dict[str, str] | None = None):
    """A study of one_leg; conditions with a setting start from states of their own."""
    settings = settings or {}
    measured = {
        each.condition: Measured(
            each, Setting(changes=settings.get(each.condition, "")), settings.get(each.condition, ""), ()
        )
        for each in results
    }
    # What these sections tell is read off results alone.
    return TaskStudy("one_leg", measured, cast(Sources, None), curves)


@pytest.fixture
def result() -> Results:
    """E.g. ``result("bc", 0.5, 0.6)``: two models of a condition."""
    return make_result


@pytest.fixture
def study() -> Callable[..., TaskStudy]:
    """A study made of results."""
    return make_study


class Made:
    """A store that is filled by hand, and the evaluations of a study of a task in it."""

    def __init__(self, folder: Path, task: str = "one_leg") -> None:
        self.store = ArtifactStore(folder)
        self._task = task
        self._evaluations: list[ArtifactRef] = []
        self._rows: list[ReportRow] = []

    def artifact(self, stage: str, kind: str, *, summary: dict[str, Any] | None = None, **recipe: Any) -> ArtifactRef:
        """An artifact of which only its manifest counts."""
        made = Recipe(stage, kind, **recipe)
        with self.store.create(made) as draft:
            draft.summary |= summary or {}
        return made.ref

    def evaluation(
        self,
        condition: str,
        checkpoint: ArtifactRef,
        *,
        seed: int = 0,
        setting: str = "",
        named: str = "",
        shift: str = "",
        **settings: Any,
    ) -> None:
        """Of a success and a failure."""
        config = {"task": self._task, "seed": seed} | ({"shift": shift} if shift else {}) | settings
        recipe = Recipe("evaluate", "evaluation", inputs={"checkpoint": (checkpoint,)}, config=config)
        with self.store.create(recipe) as draft:
            ends = enumerate((Outcome.SUCCESS, Outcome.TIMEOUT))
            rows = [EvaluationRow(number, number, outcome, 0, 9) for number, outcome in ends]
            write_evaluation(draft.path, rows)
        self._evaluations.append(recipe.ref)
        told = Setting(changes=setting, name=named)
        self._rows.append(ReportRow(condition=condition, title=condition.upper(), seed=seed, setting=told, shift=shift))

    @property
    def study(self) -> TaskStudy:
        """What is known of the evaluations."""
        return task_study(self.store, self._task, self._evaluations, self._rows)


@pytest.fixture
def made(tmp_path: Path) -> Made:
    """An empty store."""
    return Made(tmp_path / "store")
