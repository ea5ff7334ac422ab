"""What sets a group of conditions apart from the rest of a study."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Setting:
    """What a condition changes in the configuration. Settings of the same changes are equal, whatever they are called.

    Attributes:
        changes: Key by key, in words; empty if nothing. Conditions of the same changes differ in their method alone.
        name: What people read instead; the changes if empty.
    """

    changes: str = ""
    name: str = field(default="", compare=False)

    def __str__(self) -> str:
        """What people read; empty if nothing is changed."""
        return self.name or self.changes

    def __bool__(self) -> bool:
        """Whether anything is changed."""
        return bool(self.changes)

    @property
    def spelled_out(self) -> str:
        """The changes, if people read something else; empty if not."""
        return self.changes if self.name else ""

    def within(self, place: str) -> Setting:
        """The same of a configuration that is itself another one than the page's first."""
        changes = f"{place}, {self.changes}" if self.changes else place
        return Setting(changes, self.name and f"{place}, {self.name}")
