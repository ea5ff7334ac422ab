"""What of a task counts for a result: its data, not the source that writes them down."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from juicer.tasks.registry import get_task

READERS: Mapping[str, tuple[str, ...]] = {
    "rgb": ("juicer.imaging",),
    "marks": ("juicer.imaging",),
    "handling": ("juicer.expert",),
    "critical_states": ("juicer.annotation", "juicer.augmentation"),
}
"""Fields that only some packages read: for a stage that runs none of these they do not count.

A colour or mark shapes no physics, so it counts where something is drawn; how the scripted operator grasps a part
counts where that operator works. Whatever is not named here counts for every stage that looks tasks up.
"""

_REGISTRY = "juicer.tasks.registry"


def task_content(name: str, modules: Collection[str]) -> dict[str, Any]:
    """A task as JSON values, as far as it counts for a stage that runs these modules; nothing if none looks tasks up.

    Raises:
        ConfigError: If the task is not there and it counts.
    """
    if _REGISTRY not in modules:
        return {}
    packages = {module.rpartition(".")[0] for module in modules}
    unread = {field for field, readers in READERS.items() if packages.isdisjoint(readers)}
    content: dict[str, Any] = _plain(get_task(name), unread)
    return content


def _plain(value: Any, unread: Collection[str]) -> Any:
    if is_dataclass(value):
        names = (field.name for field in fields(value) if field.name not in unread)
        return {name: _plain(getattr(value, name), unread) for name in names}
    return [_plain(item, unread) for item in value] if isinstance(value, tuple) else value
