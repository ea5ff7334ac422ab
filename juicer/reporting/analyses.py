"""Analyses of policies, from their artifacts, as the report shows them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

from juicer.analysis.monitoring import watched
from juicer.analysis.sampling import SLICED
from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import StrictConfig
from juicer.reporting.content import ShownAnalysis
from juicer.reporting.lineage import cpu_seconds_of
from juicer.storage.analyses import DIMENSIONS, read_modes, read_monitor, read_samples


class AnalysisRow(StrictConfig):
    """Whose analysis the one at the same place is.

    Attributes:
        name: What the configuration calls it.
        condition: Name of the model's condition.
        title: Its title.
        seed: Seed of the model.
    """

    name: str
    condition: str
    title: str
    seed: int

    @property
    def label(self) -> str:
        """E.g. ``spread: TA+CI, seed 0``."""
        return f"{self.name}: {self.title}, seed {self.seed}"

    @property
    def file_name(self) -> str:
        """The same as the name of a file without its ending, e.g. ``spread.ta_ci.0``."""
        return f"{self.name}.{self.condition}.{self.seed}"


def shown_analyses(
    store: ArtifactStore, refs: Sequence[ArtifactRef], rows: Sequence[AnalysisRow]
) -> Iterator[ShownAnalysis]:
    """Analyses with their figures and numbers.

    Raises:
        ArtifactError: If one is missing or damaged.
    """
    for ref, row in zip(refs, rows, strict=True):
        yield shown_analysis(store, ref, row.label)


def shown_analysis(store: ArtifactStore, ref: ArtifactRef, label: str) -> ShownAnalysis:
    """One of them.

    Raises:
        ArtifactError: If it is missing or damaged.
    """
    manifest = store.manifest(ref)
    made = (manifest, *map(store.manifest, manifest.recipe.inputs.get("evaluations", ())))
    found, drawn = _SHOWN.get(manifest.recipe.stage, ("", None))
    if drawn is None or found not in manifest.summary:
        shown = ShownAnalysis(label, f"{manifest.finding or manifest.headline}.")
    else:
        shown = drawn(store, manifest, label)
        if manifest.finding:
            shown = replace(shown, sentence=f"{shown.sentence} Note: {manifest.finding}.")
    wall, cpu = sum(each.seconds for each in made), sum(map(cpu_seconds_of, made))
    return replace(shown, seconds=wall, cpu_seconds=cpu)


def _sampling(store: ArtifactStore, manifest: Manifest, label: str) -> ShownAnalysis:
    from juicer.reporting.analysis_figures import sampling_figure  # drawing libraries take long to import

    facts = manifest.summary
    apart: Mapping[str, Mapping[str, float]] = facts["distances"]
    names = (*DIMENSIONS, SLICED)
    sentence = (
        f"{facts['samples']} samples of an action at step {facts['step']} of a demonstration, by the steps in which "
        f"each was drawn. Below, Wasserstein distances to those of {facts['reference_steps']} steps, in mm, degrees "
        "and the gripper's command; sliced is all dimensions together, in standard deviations. Chance is what a "
        "second set of as many steps comes to."
    )
    sliced = {name: each[SLICED] for name, each in apart.items()}
    return ShownAnalysis(
        label,
        sentence,
        ("steps", *names),
        tuple((name, *(f"{each[key]:.3g}" for key in names)) for name, each in apart.items()),
        sampling_figure(read_samples(store.open(manifest.ref)), sliced),
        apart=sliced,
    )


def _modes(store: ArtifactStore, manifest: Manifest, label: str) -> ShownAnalysis:
    from juicer.reporting.analysis_figures import modes_figure

    rows = read_modes(store.open(manifest.ref))
    return ShownAnalysis(
        label,
        "Acting on the densest of several samples, by a Gaussian kernel. p is McNemar's, against the first.",
        ("samples", "success", "95 % interval", "episodes", "p", "ms of one core a chunk"),
        tuple(
            (
                str(row.samples),
                f"{row.successes / row.episodes:.0%}",
                f"{row.interval_low:.0%} to {row.interval_high:.0%}",
                str(row.episodes),
                f"{row.p_value:.2g}",
                f"{row.chunk_ms:.3g}",
            )
            for row in rows
        ),
        modes_figure(rows),
    )


def _monitor(store: ArtifactStore, manifest: Manifest, label: str) -> ShownAnalysis:
    from juicer.reporting.analysis_figures import monitor_figure

    facts, config = manifest.summary, manifest.recipe.config
    rows = read_monitor(store.open(manifest.ref))
    spread = watched(rows, facts["measure"], facts["action_horizon"], config["window"])
    alarms = spread.alarms(config["false_alarm_rate"])
    sentence = (
        f"{facts['failures']} of {facts['episodes']} rollouts fail. Does the spread of {config['watched_samples']} "
        f"samples tell them at step {facts['step']}, when the first success ends? Area under the ROC curve "
        f"{facts['auc']:.2f} (95 % interval {facts['auc_low']:.2f} to {facts['auc_high']:.2f}). Alarms with a "
        f"threshold that {config['false_alarm_rate']:.0%} of other successes exceed: in "
        f"{_share(alarms.false_alarms)} of successes, and in {_share(alarms.found)} of failures"
    )
    early = facts["lead_steps"]
    lead = (
        "" if early is None else f", there {early:.0f} steps (median) before they, or half of the successes, had ended"
    )
    return ShownAnalysis(
        label,
        f"{sentence}{lead}.",
        ("measure", "area under the ROC curve"),
        tuple((name.replace("_", " "), f"{auc:.2f}") for name, auc in facts["auc_by_measure"].items()),
        monitor_figure(spread, facts["measure"], facts["step"], alarms.leads),
    )


def _share(rate: float | None) -> str:
    return "none" if rate is None else f"{rate:.0%}"


_SHOWN: Mapping[str, tuple[str, Callable[[ArtifactStore, Manifest, str], ShownAnalysis]]] = {
    "sampling": ("distances", _sampling),
    "modes": ("success_rate", _modes),
    "monitor": ("auc", _monitor),
}
"""By the stage that made an analysis: a fact that is in its summary if it found anything, and how it is shown then."""
