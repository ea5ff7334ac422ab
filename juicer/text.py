"""Text for people: foreign text made fit for terminals, messages and manifests, and advice that messages share."""

from __future__ import annotations

import unicodedata

LONGEST_SHOWN = 200
"""Letters of a foreign text that a message repeats; more would bury what the message says."""

_UNSAFE_CATEGORIES = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
"""Control and formatting characters, surrogates, unassigned code points, line and paragraph separators."""


def printable(text: object, longest: int = LONGEST_SHOWN) -> str:
    r"""The text of a foreign object, cut, with every character escaped that could steer a terminal.

    Tabs and line breaks are escaped too, so that what was one value stays on one line: ``"a\nb"`` becomes ``a\nb``.
    """
    shown = str(text)
    cut = shown if len(shown) <= longest else shown[: longest - 1] + "…"
    return "".join(_escaped(letter) for letter in cut)


def adding_extra(name: str) -> str:
    """How to install the libraries of one of juicer's extras; package indices know another project by juicer's name."""
    return f"`pip install --editable '.[{name}]'` in juicer's repository adds it"


def _escaped(letter: str) -> str:
    if unicodedata.category(letter) not in _UNSAFE_CATEGORIES:
        return letter
    return letter.encode("unicode_escape").decode("ascii")
