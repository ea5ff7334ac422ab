"""One page about a run: everything on it is read from the artifacts behind its evaluations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from pydantic import Field

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.episode import Episode, Outcome
from juicer.errors import RenderingUnavailable
from juicer.evaluation import ConditionResult
from juicer.reporting.content import FilmStrip
from juicer.reporting.page import write_page
from juicer.sim.film import STEP_SECONDS, Picture, draw, evenly_spaced, write_video
from juicer.storage.episodes import EpisodeReader
from stages.report_data import ReportRow, condition_results, gather
from stages.stage import StageContext, stage

PAGE = "report.html"
FILM = "success.mp4"
EXAMPLES = "examples"
PICTURES = 8
PICTURE_SIZE = (320, 240)
STEPS_A_FRAME = 2


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
    results = condition_results(context.store, evaluations, config.rows)
    findings = list(config.findings)
    try:
        films = _film(context, _examples(context, evaluations, config, results))
    except RenderingUnavailable as error:
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
        "film": FILM if (context.draft.path / FILM).exists() else None,
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


def _film(context: StageContext, examples: list[tuple[str, Episode]]) -> tuple[FilmStrip, ...]:
    width, height = PICTURE_SIZE
    frames_due = sum(len(episode) // STEPS_A_FRAME for _, episode in examples if _is_success(episode))
    strips = []
    for model, episode in examples:
        steps = _moments(episode)
        pictures = list(draw(episode, steps, width=width, height=height))
        strips.append(_strip(model, episode, steps, pictures))
        if _is_success(episode):
            _write_film(context, episode, frames_due, context.draft.path / FILM)
    return tuple(strips)


def _write_film(context: StageContext, episode: Episode, total: int, path: Path) -> None:
    width, height = PICTURE_SIZE

    def counted() -> Iterator[Picture]:
        steps = range(0, len(episode) + 1, STEPS_A_FRAME)
        for done, picture in enumerate(draw(episode, steps, width=width, height=height), start=1):
            context.progress(min(done, total), total)
            yield picture

    write_video(path, counted())


def _moments(episode: Episode) -> list[int]:
    """Steps worth a picture: the milestones, and evenly spaced ones between start and end."""
    milestones = sorted(set(episode.record.milestones.values()))
    rest = max(2, PICTURES - len(milestones))
    return sorted({*milestones, *evenly_spaced(episode, rest)})[: PICTURES + 2]


def _strip(model: str, episode: Episode, steps: list[int], pictures: list[Picture]) -> FilmStrip:
    record = episode.record
    missed = "" if _is_success(episode) else f"; it ended as {record.outcome.value.replace('_', ' ')}"
    return FilmStrip(
        title="A success" if _is_success(episode) else "A typical failure",
        caption=f"{model}, initial state {record.seed}, {len(episode)} steps{missed}",
        frames=np.stack(pictures),
        seconds=tuple(step * STEP_SECONDS for step in steps),
        labels={steps.index(step): name for name, step in record.milestones.items() if step in steps},
    )


def _is_success(episode: Episode) -> bool:
    return episode.record.outcome is Outcome.SUCCESS
