"""The artifacts behind a report's evaluations, read once; what is missing or damaged is told, not a reason to fail."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from copy import copy

import numpy as np

from juicer.artifacts.commit import UNKNOWN
from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError, ConfigError
from juicer.evaluation import milestone_counts
from juicer.reporting.comparison import ReportRow
from juicer.reporting.content import (
    AugmentationYield,
    EstimatorErrors,
    EvaluatedEpisode,
    EvaluatedModel,
    Funnel,
    LineageNode,
    TrainingCurve,
)
from juicer.reporting.lineage import ancestors_of, checkpoint_of, nodes_of, read_lineage
from juicer.storage.curves import CURVES_FILE, read_curves
from juicer.storage.evaluations import EvaluationRow, read_evaluation
from juicer.tasks.registry import get_task

_CURVES = {"train/loss": "training", "validation/loss": "validation"}


class Sources:
    """Evaluations, and everything that they were made from.

    Attributes:
        refs: What is told of.
        problems: What could not be read, a sentence each; grows while the rest is read.
    """

    def __init__(self, store: ArtifactStore, evaluations: Sequence[ArtifactRef], rows: Sequence[ReportRow]) -> None:
        """Read the tables and every manifest.

        Args:
            store: Where they are kept.
            evaluations: What is told of.
            rows: Whose they are.

        Raises:
            ArtifactError: If an evaluation itself is missing or damaged.
        """
        self._store = store
        self._rows = rows
        self.refs = list(evaluations)
        self._tables = {ref: read_evaluation(store.open(ref, "evaluation")) for ref in dict.fromkeys(evaluations)}
        self._known = read_lineage(store, evaluations)
        self._evaluations = [store.manifest(ref) for ref in evaluations]
        self.problems: list[str] = [
            f"{ref} is no longer there or damaged; what it tells is missing here"
            for ref, manifest in self._known.items()
            if manifest is None
        ]

    def unshifted(self) -> Sources:
        """The same of the evaluations without a shift; nothing is read again."""
        places = [place for place, row in enumerate(self._rows) if not row.shift]
        usual = copy(self)
        usual._rows = [self._rows[place] for place in places]
        usual.refs = [self.refs[place] for place in places]
        usual._evaluations = [self._evaluations[place] for place in places]
        return usual

    @property
    def plain(self) -> set[str]:
        """Names of the conditions that change nothing in the configuration."""
        return {row.condition for row in self._rows if not row.setting}

    def facts(self) -> dict[str, str]:
        """Size of the demonstrations."""
        sizes: dict[str, list[str]] = {}
        for manifest in self._of_stage("ingest"):
            summary = manifest.summary
            sizes.setdefault(self.task_of(manifest), []).append(f"{summary['episodes']} ({summary['steps']} steps)")
        told = [f"{task} {' or '.join(each)}" if len(sizes) > 1 else " or ".join(each) for task, each in sizes.items()]
        return {"Demonstrations": ", ".join(told)} if told else {}

    @property
    def commits(self) -> list[str]:
        """Commits with which the models were trained and evaluated, each once, that of the last evaluation first."""
        manifests = (*self._evaluations[::-1], *self._of_stage("train"))
        return list(dict.fromkeys(str(manifest.host.get("commit", UNKNOWN)) for manifest in manifests))

    def models(self) -> Iterator[EvaluatedModel]:
        """Every model with every episode."""
        for row, manifest in zip(self._rows, self._evaluations, strict=True):
            checkpoint = checkpoint_of(manifest)
            yield EvaluatedModel(
                condition=row.title,
                seed=row.seed,
                evaluation=manifest.ref.id,
                checkpoint=checkpoint.id if checkpoint else "",
                milestones=self._milestones(manifest),
                episodes=tuple(map(_told, self._tables[manifest.ref])),
                lineage=tuple(self.lineage([manifest.ref])),
            )

    def funnels(self) -> Iterator[Funnel]:
        """Milestones of every condition in the task's order, all its models together."""
        for condition, manifests in self._by_condition():
            rows = [row for manifest in manifests for row in self._tables[manifest.ref]]
            reached = milestone_counts([row.milestones for row in rows], self._milestones(manifests[0]))
            yield Funnel(condition, len(rows), reached)

    def curves(self) -> Iterator[TrainingCurve]:
        """One for every checkpoint."""
        for manifest in self._of_stage("train"):
            try:
                curves = read_curves(self._store.open(manifest.ref, read=[CURVES_FILE]))
            except ArtifactError as error:
                self.problems.append(f"No curves of {manifest.ref}: {error}.")
                continue
            steps = np.unique([step for name in _CURVES for step in curves.get(name, ((), ()))[0]]).astype(np.int64)
            losses = {}
            for name, label in _CURVES.items():
                if name in curves:
                    values = np.full(len(steps), np.nan)
                    values[np.searchsorted(steps, curves[name][0])] = curves[name][1]
                    losses[label] = values
            label, group = self._name_of(manifest)
            yield TrainingCurve(label, steps, losses, group)

    def augmentations(self) -> Iterator[AugmentationYield]:
        """One for every set of corrective episodes."""
        for manifest in self._of_stage("augment"):
            summary = manifest.summary
            yield AugmentationYield(
                label=f"{summary['snippets']} corrective episodes of {self.task_of(manifest)}",
                kept=summary["snippets"],
                rejected=summary["rejections"],
                by_critical_state={
                    name: (counts["snippets"], counts["attempts"])
                    for name, counts in summary["by_critical_state"].items()
                },
            )

    def estimators(self) -> Iterator[EstimatorErrors]:
        """One for every estimator."""
        for manifest in self._of_stage("estimate"):
            error_mm, error_deg = manifest.summary["error_mm"], manifest.summary["error_deg"]
            errors = {name: (float(error_mm[name]), float(error_deg[name])) for name in error_mm}
            views = ", ".join(manifest.recipe.config["encoder"]["estimator"]["views"])
            yield EstimatorErrors(f"{self.task_of(manifest)}: {views} ({manifest.ref.id[:6]})", errors)

    def behind(self, refs: Sequence[ArtifactRef]) -> list[Manifest]:
        """Manifests of some of the evaluations and of everything that they were made from, parents first."""
        return [manifest for ref in ancestors_of(self._known, refs) if (manifest := self._known[ref])]

    def lineage(self, refs: Sequence[ArtifactRef]) -> Iterator[LineageNode]:
        """Some of the evaluations and everything they were made from, each once; models are called by their names."""
        names = dict(zip(self.refs[::-1], [row.label for row in self._rows][::-1], strict=True))
        names |= {ref: name for evaluation, name in names.items() if (ref := self._checkpoint(evaluation))}
        yield from nodes_of({ref: self._known[ref] for ref in ancestors_of(self._known, refs)}, names)

    def _checkpoint(self, evaluation: ArtifactRef) -> ArtifactRef | None:
        manifest = self._known[evaluation]
        return checkpoint_of(manifest) if manifest else None

    def _milestones(self, evaluation: Manifest) -> tuple[str, ...]:
        """Of the evaluation's task, or if that is not known here, those that were reached."""
        try:
            return get_task(str(evaluation.recipe.config.get("task"))).milestones
        except ConfigError:
            return tuple(dict.fromkeys(name for row in self._tables[evaluation.ref] for name in row.milestones))

    def _by_condition(self) -> Iterator[tuple[str, list[Manifest]]]:
        """Titles of the conditions, and the evaluations of each."""
        for condition, title in {row.condition: row.title for row in self._rows}.items():
            pairs = zip(self._rows, self._evaluations, strict=True)
            yield title, [manifest for row, manifest in pairs if row.condition == condition]

    def _of_stage(self, name: str) -> list[Manifest]:
        return [manifest for manifest in self._known.values() if manifest and manifest.recipe.stage == name]

    def task_of(self, data: Manifest) -> str:
        """The task of demonstrations, or of what was grown from them."""
        if data.recipe.stage == "ingest":
            return str(data.recipe.config["task"])
        parent = self._known.get(data.recipe.inputs["episodes"][0])
        return self.task_of(parent) if parent else "demonstrations that are no longer there"

    def _name_of(self, checkpoint: Manifest) -> tuple[str, str]:
        """Which model acts with a checkpoint, or grew out of it, and the group in which its curve is drawn."""
        for row, evaluation in zip(self._rows, self._evaluations, strict=True):
            if checkpoint_of(evaluation) == checkpoint.ref:
                return row.label, row.title
        for row, ref in zip(self._rows, self.refs, strict=True):
            if checkpoint.ref in ancestors_of(self._known, [ref]):
                tasks = ", ".join(checkpoint.summary["tasks"])
                return f"{row.label}, before retraining, {tasks}", f"{row.title}, before retraining"
        return checkpoint.ref.id, "other"


def origins_of(several: Sequence[Sources]) -> dict[str, str]:
    """With which code and on which machines models of some studies were trained and evaluated, each counted once."""
    evaluated = {manifest.ref: manifest for sources in several for manifest in sources._evaluations}
    trained = {manifest.ref: manifest for sources in several for manifest in sources._of_stage("train")}
    days = sorted({manifest.finished[:10] for manifest in (*trained.values(), *evaluated.values())})
    facts = {"computed": " to ".join(dict.fromkeys((days[0], days[-1])))} if days else {}
    facts |= {"juicer": _counted(str(manifest.host.get("juicer", UNKNOWN)) for manifest in evaluated.values())}
    for name, manifests in (("Trained", trained.values()), ("Evaluated", evaluated.values())):
        if manifests:
            facts[f"{name} at commit"] = _counted(manifest.host.get("commit", UNKNOWN) for manifest in manifests)
            facts[f"{name} on"] = _counted(map(_machine, manifests))
    return facts


def _told(row: EvaluationRow) -> EvaluatedEpisode:
    return EvaluatedEpisode(
        number=row.episode,
        initial_state=row.seed,
        outcome=row.outcome.value.replace("_", " "),
        parts_assembled=row.parts_assembled,
        steps=row.length,
        milestones=row.milestones,
    )


def _machine(manifest: Manifest) -> str:
    host = manifest.host
    return f"{host.get('name', UNKNOWN)}: {host.get('cpus', '?')} CPUs, {host.get('platform', UNKNOWN)}"


def _counted(values: Iterable[str]) -> str:
    """Each value once; how often, if there are several."""
    counts = Counter(values)
    if len(counts) == 1:
        return next(iter(counts))
    return "; ".join(f"{value} ({count})" for value, count in counts.most_common())
