"""Strict, frozen configuration: YAML in, typed models out, canonical JSON for identity."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, ValidationError
from pydantic_core import CoreSchema

from juicer.errors import ConfigError
from juicer.problems import first_problem
from juicer.reading import read_bounded
from juicer.text import printable
from juicer.yaml_reading import MOST_BYTES, Document, Keys, UnreadableYaml, read_yaml


def _forbid_conversions(schema: Any) -> None:
    if isinstance(schema, dict):
        for key, value in schema.items():
            # A default is a value, not a description of one.
            if key not in ("default", "metadata"):
                _forbid_conversions(value)
        if schema.get("type") in ("int", "float", "bool"):
            schema["strict"] = True
    elif isinstance(schema, list | tuple):
        for each in schema:
            _forbid_conversions(each)


class StrictConfig(BaseModel):
    """Base of every configuration: immutable, unknown keys are refused, and numbers are numbers.

    No value is turned into another kind: neither ``true`` into 1 nor 1 into ``true``, nor a text into a number.
    Infinity and NaN are refused everywhere. Every size, list and text of a configuration has bounds.
    """

    renamed: ClassVar[Mapping[str, str]] = {}
    """By the name that a key once had, what it is called now."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """The usual schema, without conversions between numbers, truth values and texts."""
        schema = handler(source)
        _forbid_conversions(schema)
        return schema


ConfigT = TypeVar("ConfigT", bound=StrictConfig)

Seed = Annotated[int, Field(ge=0, le=2**31 - 1)]
"""Root of random draws."""


def read_document(path: Path) -> Document:
    """A YAML file that holds a mapping, with the line of every value; an empty file holds an empty one.

    Raises:
        ConfigError: If the file is missing, cannot be read, or holds something else.
    """
    shown = printable(path, 500)
    try:
        document = read_yaml(read_bounded(path, MOST_BYTES))
    except FileNotFoundError:
        raise ConfigError(f"config file '{shown}' does not exist") from None
    except UnreadableYaml as error:
        raise ConfigError(f"config file '{shown}' cannot be read: {error}") from None
    except OSError as error:
        raise ConfigError(f"config file '{shown}' cannot be read: {error.strerror or error}") from None
    if document.value is None:
        return Document({}, {})
    if not isinstance(document.value, dict):
        raise ConfigError(f"config file '{shown}' must hold a mapping of keys to values")
    return document


def read_mapping(path: Path) -> dict[str, Any]:
    """Content of a YAML file that holds a mapping.

    Raises:
        ConfigError: See :func:`read_document`.
    """
    content: dict[str, Any] = read_document(path).value
    return content


Place = Callable[[Keys], str | None]
"""Says where the value at some keys was written, if that is known."""


def nowhere(keys: Keys) -> str | None:
    """The place of what stands in no file."""
    return None


def parse_config(content: Mapping[str, Any], model: type[ConfigT], origin: str, place: Place = nowhere) -> ConfigT:
    """Validate a mapping.

    Args:
        content: The mapping.
        model: What it shall become.
        origin: Where it came from, for the error.
        place: More exactly where a value came from; validators find it as their context.

    Raises:
        ConfigError: With one sentence that names the first offending key and how to mend it.
    """
    try:
        return model.model_validate(content, context=place)
    except ValidationError as error:
        problem = first_problem(error, content, model)
        raise ConfigError(f"{printable(place(problem.keys) or origin)}: {problem.sentence}") from None


def models_in(value: object) -> Iterator[BaseModel]:
    """A configuration and every one within it, also those in lists and mappings."""
    if isinstance(value, BaseModel):
        yield value
        yield from models_in([getattr(value, name) for name in type(value).model_fields])
    elif isinstance(value, Mapping):
        yield from models_in(list(value.values()))
    elif isinstance(value, list | tuple | set | frozenset):
        for item in value:
            yield from models_in(item)


def short_hash(config: BaseModel) -> str:
    """Eight digits that are equal for equal configurations, and for no others that one meets."""
    return hashlib.sha256(canonical_json(config).encode()).hexdigest()[:8]


def canonical_json(config: BaseModel | Mapping[str, Any]) -> str:
    """Text that is equal for equal configurations: sorted keys, no spaces, no NaN."""
    content = config.model_dump(mode="json") if isinstance(config, BaseModel) else config
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
