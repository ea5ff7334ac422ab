"""What an artifact holds, as a drawing that fits into its box of a lineage."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError
from juicer.pages.browsing.episodes import KINDS_WITH_EPISODES
from juicer.reporting.lineage_drawing import PREVIEW_HEIGHT, PREVIEW_WIDTH
from juicer.storage.curves import CURVES_FILE, read_curves
from juicer.text import printable

_CURVES = {"train/loss": "first", "validation/loss": "second"}
_MOST_POINTS = 120
_LINE_LETTERS, _LINES = 20, 3


def preview(store: ArtifactStore, manifest: Manifest) -> str:
    """SVG: a rate with its interval, a learning curve, images, or else what the artifact says of itself."""
    summary = manifest.summary
    if all(isinstance(summary.get(name), int | float) for name in ("success_rate", "interval_low", "interval_high")):
        return _rate(summary)
    if manifest.ref.kind == "checkpoint" and (curves := _curves(store, manifest)):
        return curves
    if manifest.ref.kind in KINDS_WITH_EPISODES:
        address = f"/lineage/strip.jpg?artifact={manifest.ref}"
        return (
            f'<image href="{address}" width="{PREVIEW_WIDTH:.0f}" height="{PREVIEW_HEIGHT:.0f}" '
            f'preserveAspectRatio="xMinYMid meet"/>'
        )
    return _words(manifest.headline)


def _rate(summary: Mapping[str, Any]) -> str:
    rate, low, high = (
        min(max(float(summary[name]), 0.0), 1.0) for name in ("success_rate", "interval_low", "interval_high")
    )
    width, y = PREVIEW_WIDTH, 34
    return (
        f'<text class="rate" x="0" y="18">{100 * rate:.0f}%</text>'
        f'<text class="id" x="54" y="17">{100 * low:.0f} to {100 * high:.0f}%</text>'
        f'<path class="whole" d="M0 {y}H{width:.0f}"/>'
        f'<path class="interval" d="M{low * width:.1f} {y}H{high * width:.1f}"/>'
        f'<circle class="rate" cx="{rate * width:.1f}" cy="{y}" r="4.5"/>'
    )


def _curves(store: ArtifactStore, manifest: Manifest) -> str:
    """Losses over the steps, both logarithmic where they are positive; nothing if there are none."""
    try:
        found = read_curves(store.open(manifest.ref, read=[CURVES_FILE]))
    except ArtifactError:
        return ""
    curves = {look: _points(*found[name]) for name, look in _CURVES.items() if name in found}
    points = [point for curve in curves.values() for point in curve]
    if len(points) < 2:
        return ""
    (left, right), (low, high) = ((min(values), max(values)) for values in zip(*points, strict=True))

    def placed(step: float, loss: float) -> str:
        x = (step - left) / (right - left or 1) * PREVIEW_WIDTH
        y = 2 + (high - loss) / (high - low or 1) * (PREVIEW_HEIGHT - 4)
        return f"{x:.1f} {y:.1f}"

    return "".join(
        f'<path class="curve {look}" d="M{"L".join(placed(*point) for point in curve)}"/>'
        for look, curve in curves.items()
        if curve
    )


def _points(steps: Sequence[int], losses: Sequence[float]) -> list[tuple[float, float]]:
    measured = [
        (float(step), math.log(loss))
        for step, loss in zip(steps, losses, strict=True)
        if math.isfinite(loss) and loss > 0
    ]
    return measured[:: -(-len(measured) // _MOST_POINTS) or 1]


def _words(headline: str) -> str:
    facts = printable(headline).split(", ")[:_LINES]
    cut = (fact if len(fact) <= _LINE_LETTERS else f"{fact[: _LINE_LETTERS - 1]}…" for fact in facts)
    return "".join(f'<text class="id" x="0" y="{11 + 15 * row}">{escape(fact)}</text>' for row, fact in enumerate(cut))
