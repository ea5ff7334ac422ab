"""A task's name in a configuration."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Annotated, Any, get_args

from pydantic import AfterValidator, BaseModel, Field, WithJsonSchema

from juicer.config import models_in
from juicer.errors import ConfigError
from juicer.tasks.registry import TASK_NAMES, get_task


def _known(name: str) -> str:
    try:
        return get_task(name).name
    except ConfigError as error:
        raise ValueError(str(error)) from None


class NamesTask:
    """Marks a field of a configuration whose value is a task's name."""


TaskName = Annotated[
    str,
    NamesTask(),
    Field(max_length=100),
    AfterValidator(_known),
    WithJsonSchema({"type": "string", "enum": list(TASK_NAMES)}),
]
"""Name of a task that is there; a choice in forms."""


def tasks_in(config: BaseModel) -> set[str]:
    """Names of the tasks that a configuration and those within it say."""
    return {
        name
        for model in models_in(config)
        for field in _task_fields(type(model))
        for name in _texts(getattr(model, field))
    }


@cache
def _task_fields(model: type[BaseModel]) -> tuple[str, ...]:
    fields = model.model_fields.items()
    return tuple(name for name, field in fields if _is_marked(field.metadata) or _says_task(field.annotation))


def _says_task(annotation: Any) -> bool:
    return _is_marked(getattr(annotation, "__metadata__", ())) or any(map(_says_task, get_args(annotation)))


def _is_marked(metadata: Iterable[Any]) -> bool:
    return any(isinstance(mark, NamesTask) for mark in metadata)


def _texts(value: Any) -> list[str]:
    if isinstance(value, str):
        return [value]
    return [item for item in value if isinstance(item, str)] if isinstance(value, Iterable) else []
