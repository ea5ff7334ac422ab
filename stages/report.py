"""One page about a run: everything on it is read from the artifacts behind its evaluations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from pydantic import Field

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.episode import Episode, Outcome
from juicer.errors import RenderingUnavailable
from juicer.evaluation import ConditionResult
from juicer.storage.episodes import EpisodeReader
from juicer.storage.tables import EXAMPLES
from stages.report_data import ReportRow, condition_results, gather
from stages.stage import StageContext, stage

PAGE = "report.html"
FILM = "success.mp4"


class ReportConfig(StrictConfig):
    """What the page says beside what the artifacts say."""

    title: str
    task: str = "one_leg"
    rows: tuple[ReportRow, ...] = ()
    findings: tuple[str, ...] = ()
    facts: Mapping[str, str] = Field(default_factory=dict)


@stage(kind="report", inputs={"evaluations": "evaluation"}, libraries=("matplotlib",))
def report(context: StageContext, *, evaluations: tuple[ArtifactRef, ...], config: ReportConfig) -> None:
    """Write the page about evaluated models, and a film of a success."""
    from juicer.reporting.page import write_page  # drawing libraries take long to import
    from stages.report_films import make_strips

    film = context.draft.path / FILM
    results = condition_results(context.store, evaluations, config.rows)
    findings = list(config.findings)
    try:
        films = make_strips(_examples(context, evaluations, config, results), film, context.progress)
    except RenderingUnavailable as error:
        film.unlink(missing_ok=True)
        films = ()
        findings.append(f"No pictures of episodes: {error}.")
    data = gather(
        context.store,
        evaluations,
        config.rows,
        title=config.title,
        task=config.task,
        facts=config.facts,
        findings=tuple(findings),
        films=films,
    )
    write_page(data, context.draft.path / PAGE)
    best = max(results, key=lambda row: row.average)
    context.draft.summary |= {
        "conditions": len(results),
        "episodes": sum(row.num_episodes for row in results),
        "best_condition": best.condition,
        "success_rate": best.average,
        "film": FILM if film.exists() else None,
    }


def _examples(
    context: StageContext, evaluations: tuple[ArtifactRef, ...], config: ReportConfig, results: list[ConditionResult]
) -> list[tuple[str, Episode]]:
    """A success of the best condition that has one, and a typical failure of it, or of the next that failed."""
    order = {row.condition: place for place, row in enumerate(sorted(results, key=lambda row: -row.average))}
    ranked = sorted(zip(config.rows, evaluations, strict=True), key=lambda pair: order[pair[0].condition])
    found: dict[bool, tuple[str, Episode]] = {}
    for row, ref in ranked:
        reader = EpisodeReader(context.store.open(ref, "evaluation") / EXAMPLES)
        for succeeded in (True, False):
            episode = _typical(reader, succeeded)
            if episode is not None and succeeded not in found:
                found[succeeded] = (f"{row.condition}, seed {row.seed}", episode)
    return [found[succeeded] for succeeded in (True, False) if succeeded in found]


def _typical(reader: EpisodeReader, succeeded: bool) -> Episode | None:
    """The first example that got as far as most of its kind."""
    indices = [index for index, record in enumerate(reader.records) if (record.outcome is Outcome.SUCCESS) == succeeded]
    if not indices:
        return None
    reached = Counter(len(reader.records[index].milestones) for index in indices)
    usual = reached.most_common(1)[0][0]
    return reader.read(next(index for index in indices if len(reader.records[index].milestones) == usual))
