"""What a user wrote: layers of keys and values, laid over one another, each value with the place it was written in."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flows.conditions import defaults
from flows.shipped import CONFIGS, find_configuration, find_preset, is_name, names, shipped_path
from juicer.config import read_document
from juicer.errors import ConfigError, did_you_mean
from juicer.text import printable
from juicer.yaml_reading import MOST_DEPTH, Document, Keys, UnreadableYaml, check_plain, read_yaml

BASE_KEY, TASKS_KEY, KIND_KEY, POLICIES_KEY = "base", "tasks", "kind", "policies"
CONDITIONS_KEY, CHANGES_KEY = "conditions", "changes"
PATH_KEYS = ("logs", "labels")
"""Keys that name files, relative to the file that they are written in: of the top level, of a task, of a condition's
changes."""
ASSIGNED = "--set"


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

    def over(self, below: Written) -> Written:
        """This content laid over another: sections are merged, everything else is replaced."""
        values, replaced = _merge(below.values, self.values)
        kept = {keys: place for keys, place in below.places.items() if not _is_below(keys, replaced)}
        return Written(values, kept | dict(self.places))

    def replacing(self, keys: Sequence[str], value: Any, place: str) -> Written:
        """The same with one value replaced as a whole; names in a list pick from a section, as in another file.

        Raises:
            ConfigError: If one of the outer keys holds a value that is no section.
        """
        picked = _picked(self.below(*keys).values, value)
        replaced: set[Keys] = {tuple(keys)} if picked is value else set()
        kept = {known: old for known, old in self.places.items() if not _is_below(known, replaced)}
        return Written(_replaced(self.values, keys, picked, place), {**kept, tuple(keys): place})

    def without(self, *left_out: str) -> Written:
        """The same without some keys of the top level."""
        return Written(
            {key: value for key, value in self.values.items() if key not in left_out},
            {keys: place for keys, place in self.places.items() if keys[0] not in left_out},
        )

    def below(self, *outer: str) -> Written:
        """The content of a section; an empty one if there is nothing in it."""
        values: Any = self.values
        for key in outer:
            values = values.get(key) if isinstance(values, Mapping) else None
        size = len(outer)
        places = {keys[size:]: place for keys, place in self.places.items() if keys[:size] == outer and keys[size:]}
        return Written(values or {}, places)

    def assigning(self, assignments: Iterable[str], folder: Path | None) -> Written:
        """The same with every ``dotted.key=value`` applied; values are YAML.

        Args:
            assignments: Later ones go first.
            folder: What paths are relative to; none if they must be absolute.

        Raises:
            ConfigError: If an assignment is none, undoes another, or descends into a value that is no section.
        """
        result, said = self, dict[tuple[str, ...], str]()
        for text in assignments:
            keys, value = _assignment(text)
            for earlier, its_text in said.items():
                if earlier[: len(keys)] == keys:
                    raise ConfigError(f"{ASSIGNED} '{printable(text)}' undoes {ASSIGNED} '{printable(its_text)}'")
            said[keys] = text
            placed: Any = _with_paths(_nested(keys, value), folder, ASSIGNED)
            for key in keys:
                placed = placed[key]
            result = result.replacing(keys, placed, ASSIGNED)
        return result


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
        if base is not None:
            own = own.without(BASE_KEY).over(written.below(POLICIES_KEY, base))
            places = {(POLICIES_KEY, name, *keys): place for keys, place in own.places.items()}
            result = Written(
                _replaced(result.values, (POLICIES_KEY, name), own.values, ""), {**places, **result.places}
            )
        elif name not in shipped and isinstance(policies[name], Mapping) and not own.below("policy", "head").values:
            raise ConfigError(f"{where}: a new policy must have a base or a policy.head{did_you_mean(name, shipped)}")
    return result


def read_written(source: Path | str, assignments: Sequence[str] = ()) -> Written:
    """A configuration by its path, or by its name if it comes with juicer, laid over its base.

    Args:
        source: The path or the name.
        assignments: What goes before what it says; paths in them are relative to the working directory.

    Raises:
        ConfigError: If a file is missing or cannot be read, or an assignment is none.
    """
    text = str(source)
    if is_name(text):
        path = find_configuration(text)
    else:
        path = _path(text, Path(), "the configuration", "it")
        if path.stem in names(CONFIGS) and not _exists(path):
            raise ConfigError(
                f"config file '{path}' does not exist; the one that comes with juicer is run as {path.stem}"
            )
    return _assigned(*_from_file(path), assignments, Path.cwd())


def take_written(content: Mapping[str, Any] | str, origin: str, assignments: Sequence[str] = ()) -> Written:
    """A configuration that stands in no file, laid over its base; paths in it must be absolute.

    Args:
        content: Its keys and values, or YAML.
        origin: What to call it in errors.
        assignments: What goes before what it says; paths in them must be absolute, too.

    Raises:
        ConfigError: If it is not valid YAML, too large, or a path is relative, or an assignment is none.
    """
    try:
        if isinstance(content, str):
            document = read_yaml(content)
        else:
            check_plain(content)
            document = Document(content, {})
    except UnreadableYaml as error:
        raise ConfigError(f"{origin}: {error}") from None
    values = {} if document.value is None else document.value
    if not isinstance(values, Mapping):
        raise ConfigError(f"{origin}: it must hold a mapping of keys to values")
    places = {keys: f"{origin}, line {line}" for keys, line in document.lines.items() if keys}
    return _assigned(Written(_with_paths(values, None, origin), places), None, assignments, None)


def _assigned(written: Written, folder: Path | None, assignments: Sequence[str], here: Path | None) -> Written:
    """A configuration laid over its base, with assignments applied; one of them may name another base.

    Args:
        written: The content.
        folder: What its paths are relative to.
        assignments: As :meth:`Written.assigning` takes them.
        here: What paths in them are relative to.
    """
    bases = [text for text in assignments if _assignment(text)[0] == (BASE_KEY,)]
    if bases:
        # It decides what the other assignments apply to.
        written, folder = written.assigning(bases, here), here
    return _over_base(written, folder).assigning([text for text in assignments if text not in bases], here)


def _from_file(path: Path) -> tuple[Written, Path]:
    """A file's content, and the folder that its paths are relative to."""
    document = read_document(path)
    folder = path.absolute().parent
    shown = _shown(path)
    places = {keys: f"{shown}:{line}" for keys, line in document.lines.items() if keys}
    return Written(_with_paths(document.value, folder, str(path)), places), folder


def _shown(path: Path) -> str:
    """A path as short as it can be understood."""
    for folder in (CONFIGS, Path.cwd()):
        if path.is_relative_to(folder):
            return str(path.relative_to(folder))
    return str(path)


def _over_base(written: Written, folder: Path | None, above: tuple[Path, ...] = ()) -> Written:
    """A file's content laid over that of its base, which may have one too, and all over what comes with juicer.

    Args:
        written: The content.
        folder: What its paths are relative to.
        above: Files that it is a base of.

    Raises:
        ConfigError: If a base is missing, or is laid over itself.
    """
    if BASE_KEY not in written.values:
        return written.over(Written({POLICIES_KEY: defaults()[POLICIES_KEY]}))
    place = written.place((BASE_KEY,)) or BASE_KEY
    path = _find_base(written.values[BASE_KEY], folder, place)
    base = _from_file(path)
    above = (*above, path.resolve())
    if len(set(above)) < len(above):
        raise ConfigError(f"{place}: base leads back to '{_shown(path)}', which is laid over this file itself")
    return written.without(BASE_KEY).over(_over_base(*base, above))


def _find_base(text: Any, folder: Path | None, origin: str) -> Path:
    if not isinstance(text, str) or not text:
        raise ConfigError(f"{origin}: base must be the name of a preset, or the path of a file")
    if is_name(text):
        return find_preset(text)
    path = _path(text, folder, origin, BASE_KEY)
    # What the examples show works from any folder.
    return path if _exists(path) else shipped_path(text) or path


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # the name is too long, or a folder may not be looked into
        return False


def _path(text: str, folder: Path | None, origin: str, key: str) -> Path:
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


def _with_paths(values: Mapping[str, Any], folder: Path | None, origin: str) -> dict[str, Any]:
    """The same with the paths in it made absolute."""
    result = dict(values)
    for key in PATH_KEYS:
        if isinstance(text := result.get(key), str):
            result[key] = str(_path(text, folder, origin, key))
    for key, section in ((TASKS_KEY, ""), (CONDITIONS_KEY, CHANGES_KEY)):
        if isinstance(each := result.get(key), Mapping):
            result[key] = {name: _with_paths_below(own, section, folder, origin) for name, own in each.items()}
    return result


def _with_paths_below(own: Any, section: str, folder: Path | None, origin: str) -> Any:
    """The same for a task, or for the section of a condition."""
    if not isinstance(own, Mapping):
        return own
    if not section:
        return _with_paths(own, folder, origin)
    return {**own, section: _with_paths_below(own[section], "", folder, origin)} if section in own else own


def _assignment(text: str) -> tuple[tuple[str, ...], Any]:
    shown = printable(text)
    key, separator, value = text.partition("=")
    keys = tuple(part.strip() for part in key.split("."))
    if not separator or not all(keys) or len(keys) > MOST_DEPTH:
        raise ConfigError(f"{ASSIGNED} '{shown}' must look like key=value, for instance evaluate.episodes=200")
    try:
        return keys, read_yaml(value).value
    except UnreadableYaml as error:
        raise ConfigError(f"{ASSIGNED} '{shown}': the value cannot be read: {error}") from None


def _nested(keys: Sequence[str], value: Any) -> dict[str, Any]:
    for key in reversed(keys):
        value = {key: value}
    nested: dict[str, Any] = value
    return nested


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
            replaced |= {(key, *keys) for keys in within}
        else:
            merged[key] = _picked(old, value)
            if merged[key] is value:
                replaced.add((key,))
    return merged, replaced


def _picked(below: Any, above: Any) -> Any:
    """What replaces a value: names in a list pick those entries of a section, in their order."""
    names = above if isinstance(above, list) and all(isinstance(name, str) for name in above) else []
    if not names or len(set(names)) < len(names) or not isinstance(below, Mapping) or not below:
        return above
    return {name: below.get(name) for name in names}


def _are_of_one_kind(below: Mapping[str, Any], above: Mapping[str, Any]) -> bool:
    """Whether two sections can be merged: what one kind of network or noise says means nothing to another."""
    return KIND_KEY not in below or KIND_KEY not in above or below[KIND_KEY] == above[KIND_KEY]


def _is_below(keys: Keys, places: set[Keys]) -> bool:
    return any(keys[:end] in places for end in range(1, len(keys) + 1))
