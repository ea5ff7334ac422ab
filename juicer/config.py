"""Strict, frozen configuration: YAML in, typed models out, canonical JSON for identity."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from juicer.errors import ConfigError, did_you_mean


class StrictConfig(BaseModel):
    """Base of every configuration: immutable, and unknown keys are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


class _Loader(yaml.SafeLoader):
    """Reads a date as the text it is: names and folders may look like one, and no value is one."""


def _text(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> str:
    return str(loader.construct_scalar(node))


_Loader.add_constructor("tag:yaml.org,2002:timestamp", _text)

ConfigT = TypeVar("ConfigT", bound=StrictConfig)


def read_mapping(path: Path) -> dict[str, Any]:
    """Content of a YAML file that holds a mapping; an empty file holds an empty one.

    Raises:
        ConfigError: If the file is missing, cannot be read, or holds something else.
    """
    try:
        content = yaml.load(path.read_text(), _Loader) or {}
    except FileNotFoundError:
        raise ConfigError(f"config file '{path}' does not exist") from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"config file '{path}' cannot be read: {' '.join(str(error).split())}") from None
    if not isinstance(content, dict):
        raise ConfigError(f"config file '{path}' must hold a mapping of keys to values")
    return content


def parse_config(content: Mapping[str, Any], model: type[ConfigT], origin: str) -> ConfigT:
    """Validate a mapping; ``origin`` names where it came from in the error.

    Raises:
        ConfigError: With one sentence that names the first offending key and how to mend it.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise ConfigError(f"{origin}: {_first_problem(error, model)}") from None


def override(content: Mapping[str, Any], assignments: Sequence[str]) -> dict[str, Any]:
    """Copy of ``content`` with every ``dotted.key=value`` applied; values are read as YAML.

    Raises:
        ConfigError: If an assignment has no ``=`` or descends into a value that is no mapping.
    """
    result = copy.deepcopy(dict(content))
    for assignment in assignments:
        key, separator, text = assignment.partition("=")
        if not separator or not key:
            raise ConfigError(f"override '{assignment}' must look like key=value")
        *parents, last = key.split(".")
        target = result
        for parent in parents:
            child = target.setdefault(parent, {})
            if not isinstance(child, dict):
                raise ConfigError(f"override '{assignment}': '{parent}' holds a value, not a section")
            target = child
        try:
            target[last] = yaml.load(text, _Loader)
        except yaml.YAMLError:
            raise ConfigError(f"override '{assignment}': the value is not valid YAML") from None
    return result


def canonical_json(config: BaseModel | Mapping[str, Any]) -> str:
    """Text that is equal for equal configurations: sorted keys, no spaces, no NaN."""
    content = config.model_dump(mode="json") if isinstance(config, BaseModel) else config
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)


def _first_problem(error: ValidationError, model: type[BaseModel]) -> str:
    problem = error.errors(include_url=False, include_context=False)[0]
    where = ".".join(str(part) for part in problem["loc"])
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] != "extra_forbidden":
        given = f", got {problem['input']!r}" if where and problem["type"] != "missing" else ""
        return f"{where + ': ' if where else ''}{message}{given}"
    *parents, last = problem["loc"]
    known = {name for owner in _models_at(model, parents) for name in owner.model_fields}
    return f"unknown key '{where}'{did_you_mean(str(last), known)}"


def _models_at(model: type[BaseModel], parents: Sequence[int | str]) -> Iterator[type[BaseModel]]:
    """Models reached from ``model`` through a location path (a union may offer several)."""
    if not parents:
        yield model
        return
    field = model.model_fields.get(str(parents[0]))
    candidates = list(_nested_models(field.annotation)) if field else []
    for candidate in candidates:
        rest = parents[1:]
        # Positions in a list, keys of a mapping and tags of a union name no field.
        while rest and rest[0] not in candidate.model_fields:
            rest = rest[1:]
        yield from _models_at(candidate, rest)


def _nested_models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _nested_models(argument)
