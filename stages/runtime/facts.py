"""What a stage says of itself and of what it makes, so that nobody else needs a list of stages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from juicer.artifacts.manifest import FINDING, HEADLINE, LABEL
from juicer.text import printable

Need = Literal["device", "devices"]
"""A device to itself; or as many as the machine has processes for one training, each of which runs the body then."""


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
        told = [f"{_words(name)} {number(value)}" for name, value in chosen.items()]
        return "; ".join(str(part) for part in (", ".join(told), summary.get(FINDING)) if part)


def number(value: float | str) -> str:
    """Three digits of a fraction, all of a count."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _words(name: str) -> str:
    return name.rpartition("/")[2].replace("_", " ")
