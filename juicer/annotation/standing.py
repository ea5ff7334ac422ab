"""What stands of all that was said: the newest word of everybody, and whether they agree."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from juicer.annotation.labels import Label
from juicer.annotation.versions import Key, Version
from juicer.text import printable

SAME_STEPS = 2
"""Marks at most so many steps apart say the same: a fifth of a second."""


@dataclass(frozen=True)
class Standing:
    """What stands about one critical state of one episode.

    Attributes:
        newest: Number of the newest version about it, whether it still stands or not.
        opinions: Newest version of each author since it was last settled, the newest last.
    """

    newest: int
    opinions: tuple[Version, ...]

    @property
    def is_disputed(self) -> bool:
        """Whether two of its opinions are too far apart to say the same."""
        steps = [version.step for version in self.opinions if version.step is not None]
        return bool(steps) and max(steps) - min(steps) > SAME_STEPS

    @property
    def agreed(self) -> Version | None:
        """The newest opinion, if all say the same."""
        return self.opinions[-1] if self.opinions and not self.is_disputed else None


def standing(versions: Iterable[Version]) -> dict[Key, Standing]:
    """What stands about every critical state about which anything was said."""
    versions = list(versions)
    undone = {version.undoes for version in versions}
    newest: dict[Key, int] = {}
    opinions: dict[Key, dict[str, Version]] = {}
    for version in versions:
        newest[version.key] = version.version
        own = opinions.setdefault(version.key, {})
        if version.undoes is not None or version.version in undone:
            continue
        if version.settles:
            own.clear()
        own.pop(version.author, None)
        own[version.author] = version
    return {key: Standing(newest[key], tuple(own.values())) for key, own in opinions.items()}


def agreed_labels(versions: Iterable[Version], path: Path) -> list[Label]:
    """What is agreed on, as labels.

    Args:
        versions: Of a file.
        path: The file, for error messages.
    """
    agreed = [each.agreed for each in standing(versions).values()]
    return [
        Label(each.episode, each.step, each.critical_state, f"{printable(path.name)}, line {each.version}")
        for each in agreed
        if each is not None and each.step is not None
    ]
