"""Figures of what else is known of a policy: PNG on a white ground, so that they can be shown anywhere."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from matplotlib import colormaps, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullFormatter, NullLocator, PercentFormatter
from numpy.typing import NDArray

from juicer.analysis.monitoring import Watched
from juicer.storage.analyses import DIMENSIONS, ModesRow

BINS, DPI = 60, 130
SUCCESS, FAILURE, REFERENCE, PLAIN, CHANCE = "#2a7f62", "#b5443c", "#333333", "#2f6db3", "#999999"
_UNITS = ("mm", "mm", "mm", "°", "°", "°", "command")
_STYLE: Any = {
    "figure.facecolor": "white",
    "font.family": "sans-serif",
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10,
    "text.parse_math": False,
    "legend.frameon": False,
}


def _own_style() -> AbstractContextManager[None]:
    """Draw in our style, whatever a ``matplotlibrc`` somewhere says."""
    return style.context(["default", _STYLE])


def sampling_figure(samples: Mapping[int, NDArray[np.float64]], sliced: Mapping[str, float]) -> bytes:
    """Distributions of every dimension of an action, a row for each number of steps; and how far each is from the last.

    Args:
        samples: ``(n, 7)`` by steps, the reference last.
        sliced: Distances from the reference by steps, and what chance alone makes of it under another name.
    """
    colors = [*colormaps["viridis"](np.linspace(0.1, 0.8, len(samples) - 1)), REFERENCE]
    with _own_style():
        figure = Figure(figsize=(13, 6.5), layout="constrained", dpi=DPI)
        *panels, last = figure.subplots(2, 4).flat
        for place, (axes, name, unit) in enumerate(zip(panels, DIMENSIONS, _UNITS, strict=True)):
            _ridges(axes, [values[:, place] for values in samples.values()], colors)
            axes.set_title(f"{'Δ' if place < 3 else ''}{name} [{unit}]")
            axes.set_yticks(range(len(samples)), [f"{steps}" for steps in samples])
            axes.set_ylabel("steps" if place % 4 == 0 else "")
        _distance_panel(last, sliced, colors)
        last.set_title(f"distance to {[*samples][-1]} steps [its deviation]")
        return _png(figure)


def _ridges(axes: Axes, rows: Sequence[NDArray[np.float64]], colors: Sequence[Any]) -> None:
    """Histograms above each other, each as high as its row."""
    low, high = np.quantile(np.concatenate(rows), [0.002, 0.998])
    room = max(0.05 * (high - low), 1e-3)
    edges = np.linspace(low - room, high + room, BINS + 1)
    for row, (values, color) in enumerate(zip(rows, colors, strict=True)):
        counts, _ = np.histogram(values, edges)
        heights = row + 0.9 * counts / max(counts.max(), 1)
        axes.fill_between(edges[:-1], heights, row, step="post", color=color, alpha=0.7, linewidth=0)
    axes.set_ylim(-0.1, len(rows))
    axes.set_xlim(edges[0], edges[-1])


def _distance_panel(axes: Axes, sliced: Mapping[str, float], colors: Sequence[Any]) -> None:
    steps = [name for name in sliced if name.isdecimal()]
    axes.bar(range(len(steps)), [sliced[name] for name in steps], color=list(colors[: len(steps)]))
    axes.set_xticks(range(len(steps)), steps)
    for name in sliced.keys() - set(steps):
        axes.axhline(sliced[name], color=CHANCE, linestyle="--", label=name)
        axes.legend(loc="upper right")
    axes.set_xlabel("steps")


def modes_figure(rows: Sequence[ModesRow]) -> bytes:
    """Success with its interval, and the cost of a chunk, over the number of samples."""
    with _own_style():
        figure = Figure(figsize=(9, 3.4), layout="constrained", dpi=DPI)
        left, right = figure.subplots(1, 2)
        samples = [row.samples for row in rows]
        rates = np.array([row.successes / row.episodes for row in rows])
        errors = [rates - [row.interval_low for row in rows], [row.interval_high for row in rows] - rates]
        left.errorbar(samples, rates, yerr=np.abs(errors), fmt="o-", color=PLAIN, capsize=4)
        left.set_ylim(0, 1.03)
        left.yaxis.set_major_formatter(PercentFormatter(1.0))
        left.set_title("success rate, 95 % interval")
        right.plot(samples, [row.chunk_ms for row in rows], "o-", color=PLAIN)
        right.set_yscale("log")
        right.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        right.yaxis.set_minor_formatter(NullFormatter())
        for row in rows:
            right.annotate(
                f"{row.chunk_ms:.3g}", (row.samples, row.chunk_ms), xytext=(6, -12), textcoords="offset points"
            )
        right.margins(x=0.15)
        right.set_ylim(0.4 * min(row.chunk_ms for row in rows), 3 * max(row.chunk_ms for row in rows))
        right.set_title("ms of one core a chunk")
        for axes in (left, right):
            axes.set_xscale("log")
            axes.set_xticks(samples, [f"{number}" for number in samples])
            axes.xaxis.set_minor_locator(NullLocator())
            axes.set_xlabel("samples at each prediction")
            axes.grid(alpha=0.3)
        return _png(figure)


def monitor_figure(spread: Watched, name: str, headline_step: int | None, leads: Sequence[int]) -> bytes:
    """A measure along rollouts, how well it tells failures as time goes by, and how early its alarms come.

    Args:
        spread: The measure along the rollouts.
        name: What it is called.
        headline_step: Step of the area under the curve that is told.
        leads: How many steps alarms in failing rollouts came before these ended, or half of the successes had ended.
    """
    with _own_style():
        figure = Figure(figsize=(13, 3.6), layout="constrained", dpi=DPI)
        first, second, third = figure.subplots(1, 3)
        steps = spread.stride * np.arange(spread.scores.shape[1])
        for group, color, label in ((~spread.failed, SUCCESS, "succeeded"), (spread.failed, FAILURE, "failed")):
            if group.any():
                _band(first, steps, spread.scores[group], color, f"{label} ({int(group.sum())})")
        first.set_title(f"{name.replace('_', ' ')}, highest so far: median, quartiles")
        first.set_ylim(bottom=0)
        first.legend(loc="lower right")
        if curve := list(spread.curve()):
            second.plot(*zip(*curve, strict=True), color=PLAIN)
        second.axhline(0.5, color=CHANCE, linestyle="--")
        if headline_step is not None:
            second.axvline(headline_step, color=CHANCE, label="first success ends")
            second.legend(loc="lower right")
        second.set_ylim(0, 1.02)
        second.set_title("area under the ROC curve, of those running")
        for axes in (first, second):
            axes.set_xlabel("step")
            axes.grid(alpha=0.3)
        if leads:
            third.hist(leads, bins=20, color=FAILURE)
        else:
            third.text(0.5, 0.5, "no alarm in a failure", ha="center", transform=third.transAxes)
        third.yaxis.set_major_locator(MaxNLocator(integer=True))
        third.set_ylim(bottom=0)
        third.set_title("steps by which alarms in failures came early")
        third.set_xlabel("steps")
        third.set_ylabel("rollouts")
        return _png(figure)


def _band(axes: Axes, steps: NDArray[np.int64], scores: NDArray[np.float64], color: str, label: str) -> None:
    running = ~np.isnan(scores).all(axis=0)
    low, middle, high = np.nanquantile(scores[:, running], [0.25, 0.5, 0.75], axis=0)
    axes.plot(steps[running], middle, color=color, label=label)
    axes.fill_between(steps[running], low, high, color=color, alpha=0.2, linewidth=0)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()
