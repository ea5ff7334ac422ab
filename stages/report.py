"""One page about a run: everything on it is read from the artifacts behind its evaluations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pydantic import Field

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.episode import Outcome
from juicer.errors import ConfigError, NothingLeft, RenderingUnavailable
from juicer.evaluation import ConditionResult
from juicer.reporting.analyses import AnalysisRow, shown_analyses
from juicer.reporting.comparison import ReportRow
from juicer.reporting.content import EpisodeVideo
from juicer.reporting.seen import views_of
from juicer.reporting.varied_images import varied_images
from juicer.storage.episodes import EpisodeReader
from juicer.storage.evaluations import EXAMPLES, read_evaluation
from juicer.study.curves import Curve
from stages.runtime.context import StageContext
from stages.runtime.stage import stage

if TYPE_CHECKING:
    from juicer.reporting.videos import Example

PAGE = "report.html"
CONFIGURATION = "configuration.yaml"
VARIED = "augmented_images"
"""Name of the figure that shows how images were varied in training, if they were."""


class ReportConfig(StrictConfig):
    """What the page says beside what the artifacts say.

    Attributes:
        title: Headline.
        task: Assembly task, whose figures of the paper are shown.
        rows: Whose evaluations they are, in their order.
        analyses: Whose analyses they are, in their order.
        curves: What is drawn over several conditions.
        findings: Sentences that a reader must not miss.
        facts: Setting of the run in a few name-value pairs.
        configuration: The whole configuration of the run, as it can be run again.
        links: Web addresses of pages about the run. They depend on the machine, so they are no part of the recipe: a
            report that is found keeps those it was made with, and one made elsewhere has none.
    """

    title: str
    task: str = "one_leg"
    rows: tuple[ReportRow, ...] = ()
    analyses: tuple[AnalysisRow, ...] = ()
    curves: tuple[Curve, ...] = ()
    findings: tuple[str, ...] = ()
    facts: Mapping[str, str] = Field(default_factory=dict)
    configuration: Mapping[str, Any] = Field(default_factory=dict)
    links: Mapping[str, str] = Field(default_factory=dict, exclude=True)


@stage(
    kind="report",
    inputs={"evaluations": "evaluation", "analyses": "analysis"},
    libraries=("matplotlib",),
    headline=("episodes",),
)
def report(
    context: StageContext,
    *,
    evaluations: tuple[ArtifactRef, ...],
    analyses: tuple[ArtifactRef, ...] = (),
    config: ReportConfig,
) -> None:
    """Write the page about evaluated models, and videos of a success and a failure."""
    from juicer.reporting.page import write_page  # drawing libraries take long to import
    from juicer.reporting.report import configuration_text, gather
    from juicer.study.material import task_study
    from juicer.study.sections import BESIDE_RATES, sections

    _check(evaluations, config)
    shown = tuple(shown_analyses(context.store, analyses, config.analyses))
    told = tuple(zip(config.analyses, shown, strict=True))
    study = task_study(context.store, config.task, evaluations, config.rows, config.curves, analyses=told)
    results = [each.result for each in study.measured.values()]
    videos, findings = _videos(context, evaluations, config, results)
    data = gather(
        study.sources,
        results,
        title=config.title,
        task=config.task,
        sections=sections([study], BESIDE_RATES),
        facts=config.facts,
        findings=(*config.findings, *findings),
        videos=videos,
        varied=tuple(varied_images(context.store, evaluations)),
        analyses=shown,
        configuration=config.configuration,
        links=config.links,
    )
    write_page(data, context.draft.path / PAGE)
    for chart in (chart for section in data.sections for chart in section.charts):
        (context.draft.path / f"{chart.name}.png").write_bytes(chart.png)
    for number, figure in enumerate(data.varied):
        (context.draft.path / f"{VARIED}{number or ''}.png").write_bytes(figure)
    for row, analysis in told:
        if analysis.png:
            (context.draft.path / f"{row.file_name}.png").write_bytes(analysis.png)
    if config.configuration:
        (context.draft.path / CONFIGURATION).write_text(configuration_text(config.configuration), encoding="utf-8")
    best = max(results, key=lambda row: row.average)
    context.draft.summary |= {
        "conditions": len(results),
        "episodes": sum(row.num_episodes for row in results),
        "best_condition": best.condition,
        "success_rate": best.average,
        "videos": sorted(path.name for path in context.draft.path.glob("*.mp4")),
    }


def _check(evaluations: tuple[ArtifactRef, ...], config: ReportConfig) -> None:
    if not evaluations:
        raise NothingLeft("there is no evaluation to report on")
    if len(evaluations) != len(config.rows):
        raise ConfigError(
            f"a report on {len(evaluations)} evaluations needs as many rows that name them, got {len(config.rows)}"
        )


def _videos(
    context: StageContext, evaluations: tuple[ArtifactRef, ...], config: ReportConfig, results: list[ConditionResult]
) -> tuple[tuple[EpisodeVideo, ...], tuple[str, ...]]:
    """Videos, and what must be said if there can be none."""
    from juicer.reporting.videos import make_videos

    try:
        return make_videos(_examples(context, evaluations, config, results), context.draft.path, context.progress), ()
    except RenderingUnavailable as error:
        for path in context.draft.path.glob("*.mp4"):
            path.unlink()
        return (), (f"No videos or images of episodes: {error}.",)


def _examples(
    context: StageContext, evaluations: tuple[ArtifactRef, ...], config: ReportConfig, results: list[ConditionResult]
) -> list[Example]:
    """A success of the best condition that has one, and a typical failure of it, or of the next that failed."""
    order = {row.condition: place for place, row in enumerate(sorted(results, key=lambda row: -row.average))}
    usual = [(row, ref) for row, ref in zip(config.rows, evaluations, strict=True) if not row.shift]
    ranked = sorted(usual, key=lambda pair: order[pair[0].condition])
    found: dict[bool, Example] = {}
    for row, ref in ranked:
        for succeeded in (True, False):
            if succeeded not in found and (example := _typical(context, row, ref, succeeded)):
                found[succeeded] = example
    return [found[succeeded] for succeeded in (True, False) if succeeded in found]


def _typical(context: StageContext, row: ReportRow, ref: ArtifactRef, succeeded: bool) -> Example | None:
    """The first kept episode that got as far as most of its kind."""
    from juicer.reporting.videos import Example

    folder = context.store.open(ref, "evaluation")
    reader = EpisodeReader(folder / EXAMPLES)
    records = list(enumerate(reader.records))
    alike = [(place, record) for place, record in records if (record.outcome is Outcome.SUCCESS) == succeeded]
    if not alike:
        return None
    usual = Counter(len(record.milestones) for _, record in alike).most_common(1)[0][0]
    place, record = next(pair for pair in alike if len(pair[1].milestones) == usual)
    number = next(entry.episode for entry in read_evaluation(folder) if entry.seed == record.seed)
    return Example(row.label, ref.id, number, reader.read(place), views_of(context.store, ref))
