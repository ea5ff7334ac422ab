"""A task's name in a configuration."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field, WithJsonSchema

from juicer.errors import ConfigError
from juicer.tasks.registry import TASK_NAMES, get_task


def _known(name: str) -> str:
    try:
        return get_task(name).name
    except ConfigError as error:
        raise ValueError(str(error)) from None


TaskName = Annotated[
    str,
    Field(max_length=100),
    AfterValidator(_known),
    WithJsonSchema({"type": "string", "enum": list(TASK_NAMES)}),
]
"""Name of a registered task; a choice in forms."""
