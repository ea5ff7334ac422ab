"""What a stage says of itself and of what it makes, so that nobody else needs a list of stages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from juicer.artifacts.manifest import FINDING, HEADLINE, LABEL
from juicer.text import printable

Need = Literal["device", "devices"]
"""A device to itself; or as many as the machine has processes for one training, each of which runs the body then."""

_UNITS = frozenset({"mm", "deg", "s"})
"""Last words of names of facts."""


@dataclass(frozen=True)
class StageFacts:
    """What a stage says of itself.

    Attributes:
        noun: What its artifact holds, in the plural, e.g. ``rollouts``.
        counts: Fact of the summary that says how many.
        headline: Facts of the summary that are worth a place on one line, in this order.
        needs: What of the machine it must have to itself while it works.
    """

    noun: str = ""
    counts: str = ""
    headline: tuple[str, ...] = ()
    needs: Need | None = None

    def texts(self, summary: Mapping[str, Any]) -> dict[str, str]:
        """The artifact in a few words, and the facts about it that fit on a line, to be added to its summary.

        What the body says of it itself stays.
        """
        texts = {HEADLINE: self._headline(summary)}
        if self.counts in summary:
            texts[LABEL] = f"{printable(summary[self.counts])} {self.noun}"
        return {name: text for name, text in texts.items() if text and name not in summary}

    def _headline(self, summary: Mapping[str, Any]) -> str:
        chosen = {name: summary[name] for name in self.headline if isinstance(summary.get(name), int | float)}
        told = [_told(name, value) for name, value in chosen.items()]
        return "; ".join(str(part) for part in (", ".join(told), summary.get(FINDING)) if part)


def number(value: float | str) -> str:
    """Three digits of a fraction, all of a count."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _told(name: str, value: float) -> str:
    """A fact in words, e.g. ``position error 7.29 mm`` for ``validation/position_error_mm``."""
    words = name.rpartition("/")[2].split("_")
    unit = [words.pop()] if words[-1] in _UNITS else []
    return " ".join([*words, number(value), *unit])
