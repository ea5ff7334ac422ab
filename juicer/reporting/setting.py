"""What sets a group of conditions apart from the rest of a study."""

from __future__ import annotations

from juicer.config import StrictConfig


class Setting(StrictConfig):
    """What a condition changes in the configuration.

    Attributes:
        changes: Key by key, in words; empty if nothing. Conditions of the same changes differ in their method alone.
        name: What people read instead; the changes if empty.
    """

    changes: str = ""
    name: str = ""

    def __str__(self) -> str:
        """What people read; empty if nothing is changed."""
        return self.name or self.changes

    def __bool__(self) -> bool:
        """Whether anything is changed."""
        return bool(self.changes)

    def within(self, place: str) -> Setting:
        """The same of a configuration that is itself another one than the page's first."""
        changes, name = (", ".join(filter(None, (place, own))) for own in (self.changes, str(self)))
        return Setting(changes=changes, name=name)
