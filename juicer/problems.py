"""What is wrong with a value, in plain words: pydantic's findings as one sentence."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from juicer.errors import did_you_mean
from juicer.text import printable

_WORDS = {
    "missing": "is missing",
    **dict.fromkeys(("int_type", "int_from_float", "int_parsing", "int_parsing_size"), "must be a whole number"),
    **dict.fromkeys(("float_type", "float_parsing"), "must be a number"),
    "finite_number": "must be a finite number",
    **dict.fromkeys(("bool_type", "bool_parsing"), "must be true or false"),
    "string_type": "must be text",
    "path_type": "must be the path of a file or folder",
    "greater_than": "must be greater than {gt}",
    "greater_than_equal": "must be at least {ge}",
    "less_than": "must be less than {lt}",
    "less_than_equal": "must be at most {le}",
    "multiple_of": "must be a multiple of {multiple_of}",
    "too_short": "must have at least {min_length} of them",
    "too_long": "must have at most {max_length} of them",
    "string_too_short": "must be at least {min_length} letters long",
    "string_too_long": "must be at most {max_length} letters long",
    "string_pattern_mismatch": "must match {pattern}",
    "union_tag_not_found": "must say its {discriminator}",
    **dict.fromkeys(("dict_type", "mapping_type", "model_type", "model_attributes_type"), "must hold keys and values"),
}
_LISTS = ("tuple_type", "list_type", "set_type", "frozen_set_type")
_CHOICES = {"enum": "expected", "literal_error": "expected", "union_tag_invalid": "expected_tags"}

_shown = reprlib.Repr()
_shown.maxlevel, _shown.maxdict, _shown.maxlist, _shown.maxtuple = 2, 4, 6, 6
_shown.maxstring = _shown.maxother = 100
_shown.maxlong = 40


@dataclass(frozen=True)
class Problem:
    """The first thing that is wrong with a mapping.

    Attributes:
        keys: Where, as keys and positions from the outermost inwards.
        sentence: What, with the place in it.
    """

    keys: tuple[str | int, ...]
    sentence: str


def first_problem(error: ValidationError, content: Any, model: type[BaseModel] | None = None) -> Problem:
    """What pydantic found first.

    Args:
        error: All that it found.
        content: What was validated.
        model: The model, which knows the keys that would be right.
    """
    details = error.errors(include_url=False)[0]
    keys = _said_keys(details["loc"], content)
    where = printable(".".join(map(str, keys)))
    if details["type"] == "extra_forbidden":
        *parents, last = details["loc"]
        owners = list(_models_at(model, parents)) if model else []
        known = {name for owner in owners for name in owner.model_fields}
        remedy = did_you_mean(str(last), known) if known else ""
        for owner in owners:
            if new := getattr(owner, "renamed", {}).get(last):
                remedy = f"; it is now {new}"
        return Problem(keys, f"unknown key '{where}'{remedy}")
    message, remedy = _message(details)
    is_whole = details["type"] == "missing" or message.endswith("?")  # a question that names what is meant
    given = f", got {show(details['input'])}" if where and not is_whole else ""
    return Problem(keys, f"{where + ': ' if where else ''}{message}{given}{remedy}")


def show(value: Any) -> str:
    """A foreign value as a message repeats it: cut, however large or deep it is."""
    try:
        return printable(_shown.repr(value))
    except (ValueError, RecursionError):  # a number of thousands of digits, for instance
        return f"a {type(value).__name__}"


def _message(details: ErrorDetails) -> tuple[str, str]:
    """What is wrong, and what is probably meant."""
    kind, context, given = details["type"], details.get("ctx", {}), details["input"]
    if kind == "value_error":
        return printable(details["msg"].removeprefix("Value error, "), 1000), ""
    if kind in _CHOICES:
        choices = re.findall(r"'([^']*)'", str(context[_CHOICES[kind]]))
        word = str(context.get("tag", given if isinstance(given, str) else ""))
        which = "kind must" if kind == "union_tag_invalid" else "must"
        near = did_you_mean(word[:100], choices) if word else ""
        return f"{which} be one of {', '.join(choices)}", near if "mean" in near else ""
    if kind in _LISTS:
        example = f", e.g. [{show(given)}]" if isinstance(given, int | float | str) else ""
        return f"must be a list{example}", ""
    if kind in _WORDS:
        limits = {name: _plain_number(value) for name, value in context.items()}
        return _WORDS[kind].format(**limits), ""
    return printable(details["msg"]), ""


def _plain_number(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _said_keys(location: Sequence[str | int], content: Any) -> tuple[str | int, ...]:
    """A location without the tags of unions, which nobody wrote."""
    keys: list[str | int] = []
    value = content
    # "[key]" says that a key itself is wrong.
    location = [key for key in location if key != "[key]"]
    for place, key in enumerate(location, start=1):
        below = _at(value, key)
        if below is None and place < len(location) and isinstance(value, Mapping):
            continue
        keys.append(key)
        value = below
    return tuple(keys)


def _at(value: Any, key: str | int) -> Any:
    if isinstance(value, Mapping):
        return value.get(key)
    if isinstance(value, list | tuple) and isinstance(key, int) and key < len(value):
        return value[key]
    return None


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
