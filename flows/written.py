"""What a user wrote: layers of keys and values, laid over one another, each value with the place it was written in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flows.conditions import defaults
from juicer.errors import ConfigError, did_you_mean
from juicer.text import printable
from juicer.yaml_reading import Keys

BASE_KEY, NAME_KEY, TASKS_KEY, KIND_KEY, POLICIES_KEY = "base", "name", "tasks", "kind", "policies"
CONDITIONS_KEY, CHANGES_KEY = "conditions", "changes"
DEFAULT_NAME = "juicer"
"""Name of a run that has no other; presets that are not the usual one add theirs."""
BY_TASK_KEY = "by_task"
"""What a configuration says of a task whichever run is for it, such as how long a preset trains for the longer ones."""
PATH_KEYS = ("logs", "labels")
"""Keys that name files, relative to the file that they are written in: of the top level, of a task, of a condition's
changes."""


def value_at(content: Mapping[str, Any], keys: Sequence[Any]) -> Any:
    """What nested mappings hold at these keys, the outermost first; None if nothing does."""
    value: Any = content
    for key in keys:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value


@dataclass(frozen=True)
class Written:
    """Keys and values, and where each was written.

    Attributes:
        values: The content. Never changed in place: what an alias repeats is there once.
        places: By keys, the file and line of a value, or the option that said it.
    """

    values: Mapping[str, Any]
    places: Mapping[Keys, str] = field(default_factory=dict)

    def place(self, keys: Keys) -> str | None:
        """Where a value, or the innermost section around it, was written."""
        return next((self.places[keys[:end]] for end in range(len(keys), 0, -1) if keys[:end] in self.places), None)

    def holds(self, keys: Keys) -> bool:
        """Whether something stands at these keys, if only null."""
        section = self.value(keys[:-1])
        return isinstance(section, Mapping) and keys[-1] in section

    def value(self, keys: Sequence[Any]) -> Any:
        """What stands at these keys; None if nothing does."""
        return value_at(self.values, keys)

    def over(self, below: Written) -> Written:
        """This content laid over another: sections are merged, everything else is replaced."""
        values, replaced = _merge(below.values, self.values)
        kept = {keys: place for keys, place in below.places.items() if not _is_below(keys, replaced)}
        return Written(values, kept | dict(self.places))

    def giving_way(self, above: Written) -> Written:
        """The same with what is said above in the place of what is said here; nothing else that is said above."""
        again = {keys: place for keys, place in above.places.items() if self.holds(keys)}
        return Written(_said_again(above.values, self.values), {**self.places, **again})

    def sections(self, key: str) -> Mapping[str, Any]:
        """The sections under a key of the top level, by name, empty ones too; nothing else that it holds."""
        held = self.values.get(key)
        named = held.items() if isinstance(held, Mapping) else ()
        return {name: own for name, own in named if own is None or isinstance(own, Mapping)}

    def with_section(self, keys: Sequence[str], content: Written) -> Written:
        """The same with a section replaced as a whole, and all of its places."""
        places = {known: place for known, place in self.places.items() if not _is_below(known, {tuple(keys)})}
        places |= {(*keys, *inner): place for inner, place in content.places.items()}
        return Written(_replaced(self.values, keys, content.values, ""), places)

    def replacing(self, keys: Sequence[str], value: Any, place: str) -> Written:
        """The same with one value replaced as a whole; names in a list pick from a section, as in another file.

        Raises:
            ConfigError: If one of the outer keys holds a value that is not a section.
        """
        picked, gone = _picked(self.value(keys), value)
        replaced = {(*keys, *inner) for inner in gone}
        kept = {known: old for known, old in self.places.items() if not _is_below(known, replaced)}
        return Written(_replaced(self.values, keys, picked, place), {**kept, tuple(keys): place})

    def without(self, *left_out: str) -> Written:
        """The same without some keys of the top level."""
        return Written(
            {key: value for key, value in self.values.items() if key not in left_out},
            {keys: place for keys, place in self.places.items() if keys[0] not in left_out},
        )

    def below(self, *outer: str) -> Written:
        """The content of a section; an empty one if there is nothing in it, or it is none."""
        section, size = self.value(outer), len(outer)
        places = {keys[size:]: place for keys, place in self.places.items() if keys[:size] == outer and keys[size:]}
        return Written(section if isinstance(section, Mapping) else {}, places)


def settled(written: Written) -> Written:
    """The same with every policy laid over its base.

    Raises:
        ConfigError: If a policy has no such base, or neither a base nor a network.
    """
    shipped, policies = defaults()[POLICIES_KEY], written.values.get(POLICIES_KEY)
    if not isinstance(policies, Mapping):
        return written  # told where the rest is checked
    based = {name: own[BASE_KEY] for name, own in policies.items() if isinstance(own, Mapping) and own.get(BASE_KEY)}
    bases = [name for name in policies if name not in based]
    result = written
    for name in policies:
        own, base = written.below(POLICIES_KEY, name), based.get(name)
        where = f"{written.place((POLICIES_KEY, name, BASE_KEY))}: {POLICIES_KEY}.{printable(name)}"
        if base is not None and base not in bases:
            near = did_you_mean(str(base), bases)
            raise ConfigError(f"{where}.{BASE_KEY}: must name a policy without a base, got '{printable(base)}'{near}")
        if base is not None and not isinstance(policies[base], Mapping):
            continue  # likewise
        if base is not None:
            own = own.without(BASE_KEY).over(written.below(POLICIES_KEY, base))
            places = {(POLICIES_KEY, name, *keys): place for keys, place in own.places.items()}
            result = Written(
                _replaced(result.values, (POLICIES_KEY, name), own.values, ""), {**places, **result.places}
            )
        elif name not in shipped and isinstance(policies[name], Mapping) and not own.value(("policy", "head")):
            raise ConfigError(f"{where}: a new policy must have a base or a policy.head{did_you_mean(name, shipped)}")
    return result


def absolute_path(text: str, folder: Path | None, origin: str, key: str) -> Path:
    """A path as an absolute one.

    Raises:
        ConfigError: If it cannot be one.
    """
    if not text or "\0" in text:
        raise ConfigError(f"{origin}: {key} must be the path of a file or folder, got '{printable(text)}'")
    try:
        path = Path(text).expanduser()
    except RuntimeError:
        raise ConfigError(f"{origin}: {key}: '{printable(text)}': there is no such user") from None
    if path.is_absolute():
        return path
    if folder is None:
        raise ConfigError(f"{origin}: {key} must be an absolute path, as it stands in no file, got '{printable(text)}'")
    return folder / path


def with_paths(values: Mapping[str, Any], folder: Path | None, origin: str) -> dict[str, Any]:
    """The same with the paths in it made absolute."""
    result = dict(values)
    for key in PATH_KEYS:
        if isinstance(text := result.get(key), str):
            result[key] = str(absolute_path(text, folder, origin, key))
    for key, section in ((TASKS_KEY, ""), (BY_TASK_KEY, ""), (CONDITIONS_KEY, CHANGES_KEY)):
        if isinstance(each := result.get(key), Mapping):
            result[key] = {name: _paths_below(own, section, folder, origin) for name, own in each.items()}
    return result


def _paths_below(own: Any, section: str, folder: Path | None, origin: str) -> Any:
    """The same for a task, or for the section of a condition."""
    if not isinstance(own, Mapping):
        return own
    if not section:
        return with_paths(own, folder, origin)
    return {**own, section: _paths_below(own[section], "", folder, origin)} if section in own else own


def _replaced(values: Mapping[str, Any], keys: Sequence[str], value: Any, place: str) -> dict[str, Any]:
    first, *rest = keys
    if not rest:
        return {**values, first: value}
    section = values.get(first)
    if section is not None and not isinstance(section, Mapping):
        held = "a list" if isinstance(section, list) else "a value"
        raise ConfigError(f"{place} {'.'.join(keys)}: '{printable(first)}' holds {held}, not a section")
    return {**values, first: _replaced(section or {}, rest, value, place)}


def _merge(below: Mapping[str, Any], above: Mapping[str, Any]) -> tuple[dict[str, Any], set[Keys]]:
    """Both together, and the places at which the upper one replaces what the lower one says."""
    merged, replaced = dict(below), set[Keys]()
    for key, value in above.items():
        old = merged.get(key)
        if isinstance(value, Mapping) and isinstance(old, Mapping) and _are_of_one_kind(old, value):
            merged[key], within = _merge(old, value)
        else:
            merged[key], within = _picked(old, value)
        replaced |= {(key, *keys) for keys in within}
    return merged, replaced


def _said_again(above: Any, below: Any) -> Any:
    """What is said below, with what is said above at the same places; names in a list leave those that they pick."""
    if _are_names(below) and isinstance(above, Mapping):
        return list(dict.fromkeys([*below, *above]))
    if not isinstance(below, Mapping):
        return above
    if _are_names(above):
        return {name: below[name] for name in above if name in below}
    if not isinstance(above, Mapping):
        return above
    return {key: _said_again(above[key], old) if key in above else old for key, old in below.items()}


def _picked(below: Any, above: Any) -> tuple[Any, set[Keys]]:
    """What replaces a value, and what is gone of it: names in a list pick entries of a section, in their order."""
    if not _are_names(above) or len(set(above)) < len(above) or not isinstance(below, Mapping) or not below:
        return above, {()}
    return {name: below.get(name, {}) for name in above}, {(name,) for name in below if name not in above}


def _are_names(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(name, str) for name in value)


def _are_of_one_kind(below: Mapping[str, Any], above: Mapping[str, Any]) -> bool:
    """Whether two sections can be merged: what one kind of network or noise says means nothing to another."""
    return KIND_KEY not in below or KIND_KEY not in above or below[KIND_KEY] == above[KIND_KEY]


def _is_below(keys: Keys, places: set[Keys]) -> bool:
    return any(keys[:end] in places for end in range(1, len(keys) + 1))
