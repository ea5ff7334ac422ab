"""Build the page."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby, pairwise
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import PIL.Image
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray

from juicer.evaluation import ConditionResult
from juicer.reporting.comparison import by_observation
from juicer.reporting.content import EpisodeVideo, EvaluatedModel, Funnel, ReportData, TrainingCurve
from juicer.reporting.figures import (
    DASHES,
    GROUP_COLORS,
    curve_figure,
    curve_groups,
    funnel_figure,
    loss_limits,
    overlay_figure,
    success_figure,
    yield_figure,
)
from juicer.reporting.lineage_drawing import lineage_graph
from juicer.text import printable

ASSETS = ("*.html.j2", "report.css", "report.js")
_STILL_QUALITY = 80
_LARGEST_OPEN_GRAPH = 24
"""Artifacts of a graph that is shown at once; a larger one is unfolded on demand."""
_UNFIT = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]")
"""Letters that HTML forbids, and those that turn the direction of a text."""


@dataclass(frozen=True)
class _Still:
    uri: str
    step: int
    seconds: float
    video_seconds: float
    label: str


@dataclass(frozen=True)
class _Video:
    content: EpisodeVideo
    uri: str
    poster: str
    stills: tuple[_Still, ...]


@dataclass(frozen=True)
class _LegendEntry:
    name: str
    number: int
    color: int
    dashes: int
    runs: int


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
    environment.globals.update(
        by_observation=by_observation,
        episode_lines=_episode_lines,
        outcomes=_outcomes,
        png_uri=partial(_data_uri, "image/png"),
        lineage_graph=lineage_graph,
    )
    limits = loss_limits(data.curves)
    page = environment.get_template("report.html.j2").render(
        data=data,
        headline=_headline(data.results),
        success=success_figure(data.results) if data.results else "",
        funnels=[(funnel, funnel_figure(funnel), _largest_loss(funnel)) for funnel in data.funnels],
        curves=[(curve, curve_figure(curve, limits)) for curve in data.curves],
        overlays=list(_overlays(data.curves, limits)),
        legend=list(_legend(data.curves)),
        yields=[(augmentation, yield_figure(augmentation)) for augmentation in data.augmentations],
        videos=list(map(_video, data.videos)),
        models=[(name, list(models)) for name, models in groupby(_sorted_models(data), lambda m: m.condition)],
        is_small_lineage=len(data.lineage) <= _LARGEST_OPEN_GRAPH,
        links=_safe_links(data.provenance.links if data.provenance else {}),
        configuration_uri=_data_uri("application/yaml", (data.provenance.configuration if data.provenance else "")),
    )
    return _UNFIT.sub(lambda match: match.group().encode("unicode_escape").decode("ascii"), page)


def _headline(results: Sequence[ConditionResult]) -> str:
    if not results:
        return ""
    best = max(results, key=lambda result: result.average)
    low, high = best.interval
    return (
        f"{best.title} succeeds in {_percent(best.average)} of {_number(best.num_episodes)} episodes "
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


def _overlays(curves: Sequence[TrainingCurve], limits: tuple[float, float]) -> Iterator[tuple[str, str]]:
    """Name and drawing of each kind of loss, all runs together; nothing if there is only one run."""
    if len(curves) > 1:
        for loss in dict.fromkeys(name for curve in curves for name in curve.losses):
            yield loss, overlay_figure(curves, loss, limits)


def _legend(curves: Sequence[TrainingCurve]) -> Iterator[_LegendEntry]:
    for number, name in enumerate(curve_groups(curves)):
        dashes = number // len(GROUP_COLORS) % len(DASHES)
        runs = sum(curve.group == name for curve in curves)
        yield _LegendEntry(name or "all", number, number % len(GROUP_COLORS), dashes, runs)


def _video(video: EpisodeVideo) -> _Video:
    stills = tuple(
        _Still(_image_uri(still.image), still.step, still.seconds, still.video_seconds, still.label)
        for still in video.moments
    )
    return _Video(video, _data_uri("video/mp4", video.mp4), _image_uri(video.poster), stills)


def _image_uri(image: NDArray[np.uint8]) -> str:
    buffer = io.BytesIO()
    PIL.Image.fromarray(image).save(buffer, format="WEBP", quality=_STILL_QUALITY)
    return _data_uri("image/webp", buffer.getvalue())


def _data_uri(media_type: str, content: bytes | str) -> str:
    encoded = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    return f"data:{media_type};base64,{base64.b64encode(encoded).decode()}"


def _safe_links(links: Mapping[str, str]) -> dict[str, str]:
    """Those that lead to a web page: others might run a script."""
    return {name: address for name, address in links.items() if _is_web_address(address)}


def _is_web_address(text: str) -> bool:
    try:
        return urlsplit(text).scheme in ("http", "https")
    except ValueError:
        return False


def _sorted_models(data: ReportData) -> list[EvaluatedModel]:
    """Models of a condition together, in the order in which the conditions first occur."""
    order = list(dict.fromkeys(model.condition for model in data.models))
    return sorted(data.models, key=lambda model: order.index(model.condition))


def _outcomes(model: EvaluatedModel) -> str:
    """E.g. ``12 timeout, 3 part lost``: how the episodes ended that did not succeed."""
    counts: dict[str, int] = {}
    for episode in model.episodes:
        if episode.outcome != "success":
            counts[episode.outcome] = counts.get(episode.outcome, 0) + 1
    return ", ".join(f"{count} {outcome}" for outcome, count in counts.items())


def _episode_lines(model: EvaluatedModel) -> str:
    """Tab-separated rows: number, initial state, outcome, parts, steps, and the milestones with their steps."""
    lines = []
    for episode in model.episodes:
        reached = sorted(episode.milestones.items(), key=lambda item: item[1])
        told = ", ".join(f"{printable(name).replace('_', ' ').replace(',', ' ')} {step}" for name, step in reached)
        cells = (
            episode.number,
            episode.initial_state,
            printable(episode.outcome),
            episode.parts_assembled,
            episode.steps,
            told or "none",
        )
        lines.append("\t".join(map(str, cells)))
    return "\n".join(lines)


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
