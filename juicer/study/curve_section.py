"""Section on curves over conditions: a table, a drawing and, where one is asked for, the curve that fits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullLocator, PercentFormatter

from juicer.reporting.comparison import best_of
from juicer.reporting.figures import PAGE, PRINT, Palette, new_figure, own_style, png_of, svg_of
from juicer.reporting.paper import PAPER_CURVES, PAPER_CURVES_ARE
from juicer.reporting.section import Chart, Section, Table
from juicer.study.curves import Curve, Saturation
from juicer.study.material import TaskStudy
from juicer.study.points import FITTED, Points, can_be_drawn, curve_points, fit_of, rivals, rounded
from juicer.study.success import interval_text, percent


def curve_section(studies: Sequence[TaskStudy]) -> Section | None:
    """Every curve of every task, as far as its conditions have results."""
    tables, charts = [], []
    for study in studies:
        for curve in study.curves:
            found = curve_points(study, curve)
            if can_be_drawn(found):
                fit = fit_of(curve, found)
                tables.append(_table(study, curve, found, fit))
                charts.append(_chart(study, curve, found, fit))
    if not charts:
        return None
    return Section(
        "curves",
        "Curves",
        "How success depends on one number",
        "Averages over models with 95 % intervals. All models of a point learned from the same demonstrations. The "
        f"paper's points were measured in another simulator, from images. {PAPER_CURVES_ARE}",
        tuple(tables),
        tuple(charts),
    )


def _table(study: TaskStudy, curve: Curve, found: Points, fit: Saturation | None) -> Table:
    paper = _paper(study, curve)
    rows = tuple(
        (
            f"{x:g}",
            result.title,
            percent(result.average),
            interval_text(result.interval),
            best_of(result),
            str(result.num_models),
            percent(paper[x]) if x in paper else "-",
        )
        for x, result in found
    )
    columns = (curve.axis, "condition", "average", "95% interval", "best", "models", "paper")
    return Table(columns, rows, f"{study.task}: {curve.title}", " ".join(_sentences(study, curve, found, fit)), 2)


def _sentences(study: TaskStudy, curve: Curve, found: Points, fit: Saturation | None) -> Iterator[str]:
    (x, best), equals = rivals(study, found)
    others = ", ".join(f"{other:g}" for other, _ in equals)
    yield f"The best average, {percent(best.average)}, is at {x:g}; " + (
        f"{others} cannot be told apart from it (paired tests, Holm)." if others else "all others are worse."
    )
    if fit:
        low, high = fit.enough_interval
        yield (
            f"The fitted curve tends to {percent(fit.top)} ({interval_text(fit.top_interval)}) and comes within a "
            f"twentieth of it at {rounded(fit.enough)} ({rounded(low)} to {rounded(high)})"
            + ("." if fit.is_seen else ", which lies beyond the points.")
        )
        if any(result.num_models < FITTED for _, result in found):
            yield f"Intervals and band are too narrow where fewer than {FITTED} models tell how far trainings differ."


def _paper(study: TaskStudy, curve: Curve) -> Mapping[float, float]:
    return PAPER_CURVES.get(study.task, {}).get(curve.name, {})


def _chart(study: TaskStudy, curve: Curve, found: Points, fit: Saturation | None) -> Chart:
    name, title = f"{study.task}_{curve.name}", f"{study.task}: {curve.title}"
    paper = _paper(study, curve)
    return Chart(
        name=name,
        title=title,
        svg=svg_of(_drawn(PAGE, curve, found, fit, paper), f"curve {name}", title),
        png=png_of(_drawn(PRINT, curve, found, fit, paper)),
        note="Dots: averages, with 95% intervals. Small dots: single models."
        + (" Line and band: the fitted curve with its 95% band." if fit else "")
        + (" Crosses: the paper." if paper else ""),
    )


def _drawn(
    palette: Palette, curve: Curve, found: Points, fit: Saturation | None, paper: Mapping[float, float]
) -> Figure:
    with own_style(palette):
        figure, axes = new_figure(height_in=3.6)
        if fit:
            axes.fill_between(fit.x, fit.low, fit.high, color=palette.accent, alpha=0.15, linewidth=0)
            axes.plot(fit.x, fit.middle, color=palette.accent, linewidth=1.6)
        for x, result in found:
            axes.plot([x, x], result.interval, color=palette.accent, linewidth=5, alpha=0.3, solid_capstyle="round")
            rates = [model.rate for model in result.models]
            if len(rates) > 1:
                axes.plot([x] * len(rates), rates, "o", color=palette.muted, markersize=3.5, markeredgewidth=0)
            axes.plot(x, result.average, "o", color=palette.accent, markersize=8, markeredgewidth=0)
        axes.plot(list(paper), list(paper.values()), "x", color=palette.second, markersize=7, markeredgewidth=1.6)
        _scale(axes, [*(x for x, _ in found), *paper], curve.axis)
        return figure


def _scale(axes: Axes, numbers: Sequence[float], label: str) -> None:
    places = sorted(set(numbers))
    if places[0] > 0 and places[-1] >= 10 * places[0]:
        axes.set_xscale("log")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xticks([each for number, each in enumerate(places) if _has_room(places, number)])
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    elif all(float(place).is_integer() for place in places):
        # Rounds and snippets are whole numbers.
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel(label)
    axes.set_ylabel("success rate")
    axes.set_ylim(-0.03, 1.03)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.grid(axis="y")


def _has_room(places: Sequence[float], number: int) -> bool:
    """Whether a label does not run into the one before it, on a logarithmic scale."""
    return number == 0 or places[number] >= 1.3 * places[number - 1]
