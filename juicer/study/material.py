"""What sections are made of: the results of a task's conditions, and the artifacts behind them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import canonical_json
from juicer.errors import ArtifactError
from juicer.evaluation import ConditionResult
from juicer.reporting.analyses import AnalysisRow
from juicer.reporting.comparison import ReportRow, by_observation, condition_results
from juicer.reporting.content import ShownAnalysis
from juicer.reporting.lineage import checkpoint_of
from juicer.reporting.setting import Setting
from juicer.reporting.sources import Sources
from juicer.study.curves import Curve

STEADY = "steady"
"""The kind of temperament that a recording has which names none."""

_OF_THE_POLICY = ("episodes", "seed", "inference_steps", "samples", "anytime")
"""Settings of an evaluation that leave alone what an initial state of a number is, and how long a policy may take."""


@dataclass(frozen=True)
class Measured:
    """A condition with its result.

    Attributes:
        result: The result.
        setting: What the condition changes in the configuration.
        states: Where its episodes start and how long they may take, as text: only where this is the same are episodes
            of a number to be compared.
        evaluations: Manifests of its models' evaluations.
        method: The condition that comes with juicer and has the same parts; empty if there is none.
        is_trained: Whether a training seed changes what it does, unlike what replays a demonstration.
    """

    result: ConditionResult
    setting: Setting
    states: str
    evaluations: tuple[Manifest, ...]
    method: str = ""
    is_trained: bool = True


@dataclass(frozen=True)
class TaskStudy:
    """Everything that is known of one assembly task.

    Attributes:
        task: Its name.
        measured: By name of the condition, in order.
        sources: The artifacts behind it.
        curves: What is drawn over several conditions.
        analyses: What else is known of some of its models.
    """

    task: str
    measured: Mapping[str, Measured]
    sources: Sources
    curves: tuple[Curve, ...] = ()
    analyses: tuple[tuple[AnalysisRow, ShownAnalysis], ...] = ()

    def result(self, condition: str) -> ConditionResult | None:
        """Result of a condition, if there is one."""
        found = self.measured.get(condition)
        return found.result if found else None

    @property
    def untrained(self) -> set[str]:
        """Names of the conditions that no training seed changes."""
        return {name for name, each in self.measured.items() if not each.is_trained}

    def tasks_behind(self, measured: Measured) -> list[str]:
        """Tasks whose demonstrations a condition learned from: one policy may have been taught several."""
        behind = self.sources.behind([each.ref for each in measured.evaluations])
        return list(dict.fromkeys(str(each.recipe.config["task"]) for each in behind if each.recipe.stage == "ingest"))

    def title_with_tasks(self, measured: Measured) -> str:
        """Title of a condition, and how many tasks its policy was taught if these are several."""
        number = len(self.tasks_behind(measured))
        return f"{measured.result.title} ({number} tasks)" if number > 1 else measured.result.title

    def are_paired(self, first: ConditionResult, second: ConditionResult) -> bool:
        """Whether two policies see the same, from the same initial states, and may take as long."""
        states = (self.measured[each.condition].states for each in (first, second))
        return len(set(states)) == len(by_observation([first, second])) == 1

    @property
    def base(self) -> str:
        """What conditions that change nothing have in common, e.g. ``50 demonstrations, randomness low``."""
        plain = [each for measured in self.measured.values() if not measured.setting for each in measured.evaluations]
        if not plain:
            return ""
        behind = self.sources.behind([each.ref for each in plain])
        sizes = dict.fromkeys(
            f"{each.summary['episodes']} demonstrations"
            for each in behind
            if each.recipe.stage == "ingest" and each.recipe.config["task"] == self.task
        )
        operators = dict.fromkeys(
            f"{each.summary['device']}{temperament_of(each)}" for each in behind if each.recipe.stage == "record"
        )
        levels = dict.fromkeys(
            f"randomness {level}" for each in plain if (level := each.recipe.config.get("randomness"))
        )
        recorded = [f"recorded by a {' or a '.join(operators)}"] if operators else []
        return ", ".join((*sizes, *recorded, *levels))

    @property
    def behind(self) -> list[Manifest]:
        """Everything that the results were made of, each artifact once, parents first."""
        return self.sources.behind([each.ref for measured in self.measured.values() for each in measured.evaluations])

    def behind_models(self, measured: Measured) -> list[Sequence[Manifest]]:
        """What each model of a condition and its usual evaluation were made of, as far as it is known."""
        usual = [each for each in measured.evaluations if not each.recipe.config.get("shift")]
        return [self.sources.behind([each.ref]) for each in usual]

    @property
    def groups(self) -> dict[str, list[Measured]]:
        """By what they change, conditions that differ in their method alone, and were evaluated alike."""
        groups: dict[tuple[Setting, str], list[Measured]] = {}
        for each in self.measured.values():
            groups.setdefault((each.setting, each.states), []).append(each)
        words: dict[str, list[Measured]] = {}
        for (setting, _), group in groups.items():
            told = str(setting)
            while told in words:
                told = ", ".join(filter(None, (told, "other initial states")))
            words[told] = group
        return words

    @property
    def tested_together(self) -> Iterator[tuple[str, list[ConditionResult]]]:
        """Results that are tested with each other, and what they have in common, as the end of a heading.

        They differ in their method alone, and their policies see the same.
        """
        for setting, group in self.groups.items():
            for seen, results in by_observation([each.result for each in group]).items():
                yield f"{under(seen)}{under(setting)}", results


def under(setting: str) -> str:
    """What a group of conditions has in common, as the end of a heading."""
    return f", {setting}" if setting else ""


def temperament_of(recording: Manifest) -> str:
    """How the operator of a recording is, behind a comma; empty of the steady one, as most recordings are."""
    kind = recording.recipe.config.get("temperament", {}).get("kind", STEADY)
    return "" if kind == STEADY else f", {kind}-like"


def by_setting(study: TaskStudy) -> Iterator[tuple[Setting, TaskStudy]]:
    """What conditions change, and the same study of those that change this, under the names of their methods.

    Where several are of one method, such as loops of more and more rounds, the last counts.
    """
    for setting in dict.fromkeys(each.setting for each in study.measured.values() if each.setting):
        alike = {each.method: each for each in study.measured.values() if each.setting == setting and each.method}
        renamed = {
            method: replace(each, setting=Setting(), result=replace(each.result, condition=method))
            for method, each in alike.items()
        }
        yield setting, replace(study, measured=renamed, curves=(), analyses=())


def task_study(
    store: ArtifactStore,
    task: str,
    evaluations: Sequence[ArtifactRef],
    rows: Sequence[ReportRow],
    curves: Sequence[Curve] = (),
    sources: Sources | None = None,
    analyses: Sequence[tuple[AnalysisRow, ShownAnalysis]] = (),
) -> TaskStudy:
    """Read what is known of a task.

    Args:
        store: Where its artifacts are.
        task: Its name.
        evaluations: Of its models.
        rows: Whose evaluations they are, in their order.
        curves: What is drawn over several conditions.
        sources: The artifacts behind the evaluations, if they have been read already.
        analyses: What else is known of its models.

    Raises:
        ArtifactError: If an evaluation is missing or damaged.
    """
    measured = {}
    for result in condition_results(store, evaluations, rows):
        own = [(ref, row) for ref, row in zip(evaluations, rows, strict=True) if row.condition == result.condition]
        manifests = tuple(store.manifest(ref) for ref, _ in own)
        row = own[0][1]
        states, is_trained = _states(manifests[0]), _is_trained(store, manifests[0])
        measured[result.condition] = Measured(result, row.setting, states, manifests, row.method, is_trained)
    return TaskStudy(task, measured, sources or Sources(store, evaluations, rows), tuple(curves), tuple(analyses))


def _is_trained(store: ArtifactStore, evaluation: Manifest) -> bool:
    """Whether a policy was trained, as all are of which nothing is known any more."""
    checkpoint = checkpoint_of(evaluation)
    try:
        return checkpoint is None or store.recipe(checkpoint).stage != "memorise"
    except ArtifactError:
        return True


def _states(evaluation: Manifest) -> str:
    config = evaluation.recipe.config
    return canonical_json({key: value for key, value in config.items() if key not in _OF_THE_POLICY})
