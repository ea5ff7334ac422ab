"""Build the page."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from PIL import Image

from juicer.evaluation import ConditionResult
from juicer.reporting.content import DatasetSize, FilmStrip, Funnel, ReportData, StageCost
from juicer.reporting.figures import curve_figure, funnel_figure, loss_limits, success_figure, yield_figure
from juicer.reporting.lineage import lineage_graph

ASSETS = ("report.html.j2", "report.css")
SOURCES = ("teleop", "rollout", "augmentation")
_FRAME_QUALITY = 82


@dataclass(frozen=True)
class _Frame:
    uri: str
    seconds: float
    label: str


def write_page(data: ReportData, path: Path) -> None:
    """Write the report to ``path``."""
    path.write_text(render_page(data), encoding="utf-8")


def render_page(data: ReportData) -> str:
    """HTML of the report: one file that loads nothing from anywhere. Equal data gives an equal page."""
    environment = Environment(
        loader=PackageLoader("juicer.reporting", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(duration=_duration, number=_number, percent=_percent)
    limits = loss_limits(data.curves)
    return environment.get_template("report.html.j2").render(
        data=data,
        sources=SOURCES,
        headline=_headline(data.results),
        success=success_figure(data.results) if data.results else "",
        funnels=[(funnel, funnel_figure(funnel), _largest_loss(funnel)) for funnel in data.funnels],
        curves=[(curve, curve_figure(curve, limits)) for curve in data.curves],
        yields=[(augmentation, yield_figure(augmentation)) for augmentation in data.augmentations],
        films=[(film, _frames(film)) for film in data.films],
        dataset_scale=max((_total(size) for size in data.datasets), default=0.0),
        dataset_total=_total,
        lineage=lineage_graph(data.lineage),
        total_cost=_sum_costs(data.costs),
    )


def _headline(results: Sequence[ConditionResult]) -> str:
    if not results:
        return ""
    best = max(results, key=lambda result: result.average)
    low, high = best.interval
    return (
        f"{best.condition} succeeds in {_percent(best.average)} of {_number(best.num_episodes)} episodes "
        f"(95% interval {100 * low:.0f} to {_percent(high)})"
    )


def _largest_loss(funnel: Funnel) -> str:
    """Sentence that names the step at which most episodes are lost."""
    stations = [("the start", funnel.num_episodes), *funnel.reached.items()]
    losses = [(before[1] - after[1], before[0], after[0]) for before, after in pairwise(stations)]
    lost, before, after = max(losses, key=lambda loss: loss[0], default=(0, "", ""))
    if lost <= 0:
        return "No episode is lost."
    names = (before.replace("_", " "), after.replace("_", " "))
    return f"Most are lost between {names[0]} and {names[1]}: {lost} of {funnel.num_episodes}."


def _frames(film: FilmStrip) -> list[_Frame]:
    frames = []
    for index, (picture, seconds) in enumerate(zip(film.frames, film.seconds, strict=True)):
        buffer = io.BytesIO()
        Image.fromarray(picture).save(buffer, format="WEBP", quality=_FRAME_QUALITY)
        uri = "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode()
        frames.append(_Frame(uri, seconds, film.labels.get(index, "").replace("_", " ")))
    return frames


def _total(size: DatasetSize) -> float:
    return sum(size.timesteps.values())


def _sum_costs(costs: Sequence[StageCost]) -> StageCost:
    return StageCost(
        stage="together",
        artifacts=sum(cost.artifacts for cost in costs),
        seconds=sum(cost.seconds for cost in costs),
        megabytes=sum(cost.megabytes for cost in costs),
    )


def _duration(seconds: float) -> str:
    """E.g. ``0.4 s``, ``12 s``, ``3 min 05 s``, ``2 h 10 min``."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes_left = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes_left:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def _number(value: float) -> str:
    """Rounded, with thin spaces between thousands."""
    return f"{round(value):,}".replace(",", "\u2009")


def _percent(rate: float) -> str:
    return f"{100 * rate:.0f}%"
