"""Success rates of conditions that differ in one number: which they are, and the curve that fits them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from juicer.config import StrictConfig
from juicer.evaluation import ConditionResult, Interval, wilson_interval
from juicer.seeding import stream
from juicer.text import printable

MOST_POINTS = 100
LEAST_FITTED = 4
"""Points through which a curve of two parameters is drawn."""
REFITS = 300
NEARLY = 0.95
"""Share of the plateau at which a curve counts as saturated."""

Number = Annotated[float, Field(ge=-1e12, le=1e12)]
"""Place of a point on the axis."""


class CurveConfig(StrictConfig):
    """Conditions that make a curve, and the number in which they differ."""

    title: str = Field(min_length=1, max_length=100, description="what the curve shows")
    axis: str = Field(min_length=1, max_length=60, description="what the number is, with its unit")
    x: str = Field(
        default="", max_length=200, description="key of the configuration that holds it, e.g. record.demonstrations"
    )
    fit: Literal["saturating", "none"] = Field(default="none", description="the curve that is drawn through the points")
    conditions: dict[Annotated[str, Field(max_length=40)], Number | None] = Field(
        min_length=1,
        max_length=MOST_POINTS,
        description="names, or names with the number where the key does not say it",
    )

    @field_validator("conditions", mode="before")
    @classmethod
    def _names_alone(cls, given: Any) -> Any:
        is_list = isinstance(given, list | tuple) and all(isinstance(name, str) for name in given)
        return dict.fromkeys(given) if is_list else given

    def narrowed(self, conditions: Collection[str]) -> CurveConfig:
        """The same over some of its conditions."""
        kept = {name: value for name, value in self.conditions.items() if name in conditions}
        return self.model_copy(update={"conditions": kept})

    def number(self, condition: str, configuration: Mapping[str, Any], name: str) -> float:
        """The number of a condition: said by the curve itself, or else by the configuration.

        Raises:
            ValueError: If neither says it.
        """
        value: Any = self.conditions[condition]
        if value is None:
            value = configuration
            for key in self.x.split("."):
                value = value.get(key) if isinstance(value, Mapping) else None
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(
                f"{name}: the configuration of condition {condition} holds no number at x '{printable(self.x)}'; "
                f"name another key, or write {condition}: NUMBER under {name}.conditions"
            )
        return float(value)


class Curve(StrictConfig):
    """A curve whose numbers are known.

    Attributes:
        name: Its name, by which the paper's points are found.
        title: What it shows.
        axis: What the number is.
        fit: Which curve is drawn through the points.
        points: The number of each condition.
    """

    name: str
    title: str
    axis: str
    fit: Literal["saturating", "none"]
    points: Mapping[str, float]


@dataclass(frozen=True)
class Saturation:
    """The curve ``top * (1 - exp(-x / scale))`` through success rates.

    Attributes:
        top: Rate that it tends to.
        top_interval: 95 % interval of this, over models and episodes.
        enough: Where it reaches 95 % of this.
        enough_interval: The same for that.
        x: Where the band below is given ``(K,)``.
        low: Lower end of the 95 % band ``(K,)``.
        middle: The curve ``(K,)``.
        high: Upper end of the band ``(K,)``.
    """

    top: float
    top_interval: Interval
    enough: float
    enough_interval: Interval
    x: NDArray[np.float64]
    low: NDArray[np.float64]
    middle: NDArray[np.float64]
    high: NDArray[np.float64]

    @property
    def is_seen(self) -> bool:
        """Whether the curve saturates by its last point, and not where nothing was measured."""
        return bool(self.enough <= self.x[-1])


def fit_saturation(x: Sequence[float], results: Sequence[ConditionResult]) -> Saturation | None:
    """Fit the curve by least squares, each point counting by its episodes; None if there are too few points.

    Intervals come from fitting it again to models and rates that are drawn anew; of two models a point they are too
    narrow.
    """
    if len(set(x)) < LEAST_FITTED or min(x) < 0:
        return None
    places = np.asarray(x, float)
    widths = np.array([_width(result) for result in results])
    rng = stream(0, "fitted curve")
    best = _fit(places, np.array([result.average for result in results]), widths)
    if best is None:
        return None
    again = [_fit(places, np.array([_drawn(result, rng) for result in results]), widths) for _ in range(REFITS)]
    fits = np.array([fit for fit in again if fit is not None])
    grid = np.linspace(places.min(), places.max(), 200) if places.min() <= 0 else np.geomspace(min(x), max(x), 200)
    band = np.array([_saturating(grid, top, scale) for top, scale in fits])
    reach = -np.log(1 - NEARLY)
    quantiles = [0.025, 0.975]
    return Saturation(
        top=float(best[0]),
        top_interval=_pair(np.quantile(fits[:, 0], quantiles)),
        enough=float(best[1] * reach),
        enough_interval=_pair(np.quantile(fits[:, 1] * reach, quantiles)),
        x=grid,
        low=np.quantile(band, quantiles[0], axis=0),
        middle=_saturating(grid, *best),
        high=np.quantile(band, quantiles[1], axis=0),
    )


def _width(result: ConditionResult) -> float:
    """Of the interval of all episodes together: how far a few models lie apart is luck, and no measure of exactness."""
    low, high = wilson_interval(sum(sum(model.successes) for model in result.models), result.num_episodes)
    return high - low


def _saturating(x: NDArray[np.float64], top: float, scale: float) -> NDArray[np.float64]:
    return np.asarray(top * -np.expm1(-x / scale))


def _fit(x: NDArray[np.float64], rates: NDArray[np.float64], widths: NDArray[np.float64]) -> tuple[float, float] | None:
    from scipy.optimize import curve_fit  # takes half a second to import

    start = (min(1.0, max(rates.max(), 0.05)), float(np.median(x[x > 0])))
    limits = ([0.0, x[x > 0].min() / 100], [1.0, x.max() * 100])
    try:
        (top, scale), _ = curve_fit(_saturating, x, rates, p0=start, sigma=widths, bounds=limits)
    except RuntimeError:  # it did not converge
        return None
    return float(top), float(scale)


def _drawn(result: ConditionResult, rng: np.random.Generator) -> float:
    """Average of models drawn from those of a condition, each with a rate that its episodes leave possible.

    Rates come from the posterior under Jeffreys' prior: episodes drawn anew would always repeat a rate of 0 or 1.
    """
    successes = np.array([sum(model.successes) for model in result.models])
    failures = np.array([len(model.successes) for model in result.models]) - successes
    models = rng.integers(len(successes), size=len(successes))
    return float(np.mean(rng.beta(successes[models] + 0.5, failures[models] + 0.5)))


def _pair(values: NDArray[np.float64]) -> Interval:
    return float(values[0]), float(values[1])
