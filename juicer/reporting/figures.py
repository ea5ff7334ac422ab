"""Charts as inline SVG that follows the page's colour scheme.

Matplotlib draws with the placeholder colours below; each is then replaced by the page's CSS variable of
the same meaning, so that one drawing serves light and dark. Charts are drawn narrow (460 px), so that
their lettering stays legible on a small screen.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from html import escape
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, PercentFormatter
from numpy.typing import NDArray

from juicer.evaluation import ConditionResult
from juicer.reporting.content import AugmentationYield, Funnel, TrainingCurve
from juicer.text import printable

INK, MUTED, GRID, ACCENT, SECOND, SOFT = "#010101", "#020202", "#030303", "#040404", "#050505", "#060606"
GROUP_COLORS = tuple(f"#0707{number:02x}" for number in range(8))
"""Of runs that are laid over each other."""
_VARIABLES = {
    **{INK: "ink", MUTED: "muted", GRID: "grid", ACCENT: "accent", SECOND: "second", SOFT: "soft"},
    **{color: f"run{number}" for number, color in enumerate(GROUP_COLORS)},
}
DASHES: tuple[Any, ...] = ("solid", (0, (5, 1.6)), (0, (1.4, 1.4)))
"""Line styles of the groups that share a colour, in turn."""
_MOST_POINTS = 400
"""Points of a drawn curve; more would not be seen."""
_LONGEST_NAME = 48
_WIDTH_IN = 6.4


@dataclass(frozen=True)
class Palette:
    """Colours of a drawing."""

    ink: str
    muted: str
    grid: str
    accent: str
    second: str


PAGE = Palette(INK, MUTED, GRID, ACCENT, SECOND)
"""What the page replaces by its own."""
PRINT = Palette("#1d2126", "#5d6671", "#dfe1df", "#c2570c", "#2c6e91")
"""For files of their own: the page's colours on white."""
_STYLE: Any = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 13,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.linewidth": 0.8,
    "text.parse_math": False,
    "xtick.major.size": 0,
    "ytick.major.size": 0,
    "xtick.minor.size": 0,
    "ytick.minor.size": 0,
    "legend.frameon": False,
}


def own_style(palette: Palette = PAGE) -> AbstractContextManager[None]:
    """Draw in our style, whatever a ``matplotlibrc`` in the working directory or in the user's home says."""
    colors: Any = {
        "axes.edgecolor": palette.grid,
        "axes.labelcolor": palette.muted,
        "grid.color": palette.grid,
        "text.color": palette.ink,
        "xtick.color": palette.muted,
        "ytick.color": palette.ink,
    }
    return style.context(["default", _STYLE | colors])


def success_figure(results: Sequence[ConditionResult]) -> str:
    """Success rates with their intervals; small dots are the trained models."""
    with own_style():
        figure, axes = new_figure(height_in=0.9 + 0.42 * len(results))
        for row, result in enumerate(results):
            axes.plot(result.interval, [row, row], color=ACCENT, linewidth=6, alpha=0.3, solid_capstyle="round")
            rates = [model.rate for model in result.models]
            if len(rates) > 1:
                axes.plot(rates, np.full(len(rates), row), "o", color=MUTED, markersize=4, markeredgewidth=0)
            axes.plot(result.average, row, "o", color=ACCENT, markersize=9, markeredgewidth=0)
        axes.set_yticks(range(len(results)), [printable(result.title, _LONGEST_NAME) for result in results])
        axes.set_ylim(len(results) - 0.4, -0.6)
        axes.set_xlim(-0.02, 1.02)
        axes.xaxis.set_major_formatter(PercentFormatter(1.0))
        axes.set_xlabel("success rate")
        axes.grid(axis="x")
        return svg_of(figure, "success", "Success rate of each condition with its 95% interval")


def funnel_figure(funnel: Funnel) -> str:
    """Episodes that reached each milestone, as bars from all to those that succeeded."""
    names = ["started", *funnel.reached]
    counts = [funnel.num_episodes, *funnel.reached.values()]
    with own_style():
        figure, axes = new_figure(height_in=0.35 + 0.36 * len(names))
        rows = range(len(names))
        axes.barh(rows, [funnel.num_episodes] * len(names), color=SOFT, height=0.72)
        axes.barh(rows, counts, color=ACCENT, height=0.72, alpha=0.85)
        for row, count in enumerate(counts):
            axes.text(funnel.num_episodes * 1.03, row, _share(count, funnel.num_episodes), va="center", color=INK)
        axes.set_yticks(rows, list(map(_words, names)))
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.set_xlim(0, max(1, funnel.num_episodes) * 1.28)
        _bare(axes)
        return svg_of(figure, f"funnel {funnel.condition}", f"Milestones reached under {funnel.condition}")


def curve_figure(curve: TrainingCurve, limits: tuple[float, float]) -> str:
    """Losses of one training run over its steps, on the loss scale all runs share."""
    with own_style():
        figure, axes = new_figure(height_in=2.5)
        for (name, values), color in zip(curve.losses.items(), (ACCENT, SECOND, MUTED), strict=False):
            axes.plot(*_drawn(curve.steps, values), color=color, linewidth=1.6, label=printable(name, _LONGEST_NAME))
        _scale_losses(axes, limits)
        if curve.losses:
            axes.legend(loc="upper right", labelcolor=INK)
        return svg_of(figure, f"curve {curve.label}", f"Losses of {curve.label}")


def overlay_figure(curves: Sequence[TrainingCurve], loss: str, limits: tuple[float, float]) -> str:
    """One loss of every training run, laid over each other; runs of a group share colour and line style.

    Each line has the class ``run-group-<number of its group>``, see :func:`curve_groups`.
    """
    groups = curve_groups(curves)
    with own_style():
        figure, axes = new_figure(height_in=3.6)
        for curve in curves:
            if loss in curve.losses:
                number = groups.index(curve.group)
                (line,) = axes.plot(
                    *_drawn(curve.steps, curve.losses[loss]),
                    color=GROUP_COLORS[number % len(GROUP_COLORS)],
                    linestyle=DASHES[number // len(GROUP_COLORS) % len(DASHES)],
                    linewidth=1.5,
                    alpha=0.85,
                )
                line.set_gid(f"run-group-{number}")
        _scale_losses(axes, limits)
        drawing = svg_of(figure, f"overlay {loss}", f"{loss} loss of every training run")
        return re.sub(r' id="(run-group-[0-9]+)"', r' class="\1"', drawing)


def curve_groups(curves: Sequence[TrainingCurve]) -> list[str]:
    """Groups of runs in the order of their first occurrence."""
    return list(dict.fromkeys(curve.group for curve in curves))


def _drawn(
    steps: NDArray[np.integer], values: NDArray[np.floating]
) -> tuple[NDArray[np.integer], NDArray[np.floating]]:
    """The points of a curve that a logarithmic scale can show, thinned out evenly if there are very many."""
    measured = np.flatnonzero(np.isfinite(values) & (values > 0))
    if len(measured) > _MOST_POINTS:
        measured = measured[np.linspace(0, len(measured) - 1, _MOST_POINTS).round().astype(int)]
    return steps[measured], values[measured]


def _scale_losses(axes: Axes, limits: tuple[float, float]) -> None:
    axes.set_yscale("log")
    axes.set_ylim(*limits)
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if limits[1] > 20 * limits[0] else (1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("optimiser step")
    axes.locator_params(axis="x", nbins=6)
    axes.tick_params(axis="y", which="both", labelcolor=MUTED)
    axes.grid(axis="y", which="major")


def yield_figure(augmentation: AugmentationYield) -> str:
    """Corrective trajectories kept, and rejected by reason."""
    rejected = sorted(augmentation.rejected.items(), key=lambda item: -item[1])
    names = ["kept", *(_words(reason) for reason, _ in rejected)]
    counts = [augmentation.kept, *(count for _, count in rejected)]
    longest = max(1, *counts)
    with own_style():
        figure, axes = new_figure(height_in=0.35 + 0.36 * len(names))
        axes.barh(range(len(names)), counts, color=[ACCENT, *[SECOND] * len(rejected)], height=0.72, alpha=0.85)
        for row, count in enumerate(counts):
            axes.text(count + longest * 0.03, row, _share(count, sum(counts)), va="center", color=INK)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.set_xlim(0, longest * 1.3)
        _bare(axes)
        return svg_of(figure, f"yield {augmentation.label}", f"Yield of augmentation: {augmentation.label}")


def loss_limits(curves: Sequence[TrainingCurve]) -> tuple[float, float]:
    """Range of the positive, finite losses of all runs, a little widened; ``(0.1, 1)`` if there are none."""
    values = np.concatenate([np.ravel(loss) for curve in curves for loss in curve.losses.values()] or [np.zeros(0)])
    values = values[np.isfinite(values) & (values > 0)]
    return (float(values.min()) / 1.2, float(values.max()) * 1.2) if values.size else (0.1, 1.0)


def new_figure(height_in: float) -> tuple[Figure, Axes]:
    """An empty drawing, as wide as all."""
    # A figure of its own, not pyplot's: nothing global is left behind, and no screen is asked for.
    figure = Figure(figsize=(_WIDTH_IN, height_in), layout="constrained")
    return figure, figure.subplots()


def _bare(axes: Axes) -> None:
    axes.set_xticks([])
    axes.spines["bottom"].set_visible(False)
    axes.spines["left"].set_visible(False)


def _words(name: str) -> str:
    return printable(name, _LONGEST_NAME).replace("_", " ")


def _share(count: int, total: int) -> str:
    return f"{count}  ({count / total:.0%})" if total else f"{count}"


def png_of(figure: Figure) -> bytes:
    """A drawing as a file of its own."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150, facecolor="white", metadata={"Software": None})
    return buffer.getvalue()


def svg_of(figure: Figure, name: str, description: str) -> str:
    """A drawing as a part of the page.

    Args:
        figure: The drawing, in the colours of :data:`PAGE`.
        name: By which it differs from others on the page.
        description: For those who do not see it.
    """
    buffer = io.StringIO()
    # The salt makes the ids within the drawing differ from those of its neighbours on the page, and repeat.
    with mpl.rc_context({"svg.hashsalt": printable(name)}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    svg = re.sub(r"^.*?<svg ", "<svg ", buffer.getvalue(), count=1, flags=re.DOTALL)
    svg = re.sub(r'<svg [^>]*?viewBox="([^"]*)"[^>]*>', _opening_tag(description), svg, count=1)
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' id="(?:figure|axes|patch|text|line2d|matplotlib\.axis|xtick|ytick|legend)_[0-9]+"', "", svg)
    svg = re.sub(r"<defs>\s*<style.*?</defs>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"font: ([0-9.]+px) [^;\"]*", r"font-size: \1", svg)
    svg = re.sub(r"font-family: [^;\"]*;? ?", "", svg)
    for color, variable in _VARIABLES.items():
        svg = svg.replace(color, f"var(--{variable})")
    return svg


def _opening_tag(description: str) -> str:
    label = escape(printable(description)).replace("\\", "/")
    return rf'<svg class="chart" role="img" aria-label="{label}" viewBox="\1">'
