"""Reading what a user wrote: a file or a text, laid over its base, with what the command line says of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flows.by_task import for_its_tasks, give_way, lay_over
from flows.conditions import defaults
from flows.shipped import CONFIGS, PRESETS, find_configuration, find_preset, is_name, names, shipped_path
from flows.written import (
    BASE_KEY,
    DEFAULT_NAME,
    NAME_KEY,
    POLICIES_KEY,
    TASKS_KEY,
    Written,
    absolute_path,
    with_paths,
)
from juicer.config import read_document
from juicer.errors import ConfigError
from juicer.text import printable
from juicer.yaml_reading import MOST_DEPTH, Document, Keys, UnreadableYaml, check_plain, read_yaml

ASSIGNED = "--set"


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
        path = absolute_path(text, Path(), "the configuration", "it")
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
    return _assigned(Written(with_paths(values, None, origin), places), None, assignments, None)


def _assigned(written: Written, folder: Path | None, assignments: Sequence[str], here: Path | None) -> Written:
    """A configuration laid over its base, with assignments applied; one of them may name another base.

    Args:
        written: The content.
        folder: What its paths are relative to.
        assignments: As :func:`_assign` takes them.
        here: What paths in them are relative to.
    """
    bases = [text for text in assignments if _assignment(text)[0] == (BASE_KEY,)]
    # A base decides what the other assignments apply to.
    preset = _preset(_assign(Written({}), bases, here).values.get(BASE_KEY), here)
    if bases and preset is None:
        written, folder = _assign(written, bases, here), here
    whole = _over_base(written, folder, preset=preset)
    if preset and whole.values != _over_base(written, folder).values:
        whole = _renamed(whole, preset.resolve().stem)
    return for_its_tasks(_assign(whole, [text for text in assignments if text not in bases], here))


def _assign(written: Written, assignments: Sequence[str], folder: Path | None) -> Written:
    """A configuration with every ``dotted.key=value`` applied, later ones first; values are YAML.

    Args:
        written: The configuration.
        assignments: The texts.
        folder: What paths in them are relative to; none if they must be absolute.

    Raises:
        ConfigError: If an assignment is not of this form, undoes another, or descends into what is not a section.
    """
    said = dict[Keys, str]()
    for text in assignments:
        keys, value = _assignment(text)
        for earlier, its_text in said.items():
            if earlier[: len(keys)] == keys:
                raise ConfigError(f"{ASSIGNED} '{printable(text)}' undoes {ASSIGNED} '{printable(its_text)}'")
        said[keys] = text
        for key in reversed(keys):
            value = {key: value}
        layer = Written(with_paths(value, folder, ASSIGNED), {keys: ASSIGNED})
        written = give_way(written, layer).replacing(keys, layer.value(keys), ASSIGNED)
    return written


def _assignment(text: str) -> tuple[tuple[str, ...], Any]:
    """Keys and value of ``dotted.key=value``.

    Raises:
        ConfigError: If it is not of this form, or the value is not YAML.
    """
    shown = printable(text)
    key, separator, value = text.partition("=")
    keys = tuple(part.strip() for part in key.split("."))
    if not separator or not all(keys) or len(keys) > MOST_DEPTH:
        raise ConfigError(f"{ASSIGNED} '{shown}' must look like key=value, for instance evaluate.episodes=200")
    try:
        return keys, read_yaml(value).value
    except UnreadableYaml as error:
        raise ConfigError(f"{ASSIGNED} '{shown}': the value cannot be read: {error}") from None


def _renamed(whole: Written, preset: str) -> Written:
    """The same with the preset in its name: with other networks, or other eyes, it is a study of its own."""
    named: list[tuple[str, ...]] = [(NAME_KEY,), *((TASKS_KEY, task, NAME_KEY) for task in whole.sections(TASKS_KEY))]
    for keys in named:
        name = whole.value(keys)
        if isinstance(name, str) and name != f"{DEFAULT_NAME}_{preset}":
            whole = whole.replacing(keys, f"{name}_{preset}", ASSIGNED)
    return whole


def _preset(base: Any, folder: Path | None) -> Path | None:
    """File of the preset that a base is, if it is one that comes with juicer."""
    found = None if base is None else _find_base(base, folder, ASSIGNED)
    return found if found and _is_preset(found) else None


def _from_file(path: Path) -> tuple[Written, Path]:
    """A file's content, and the folder that its paths are relative to."""
    document = read_document(path)
    folder = path.absolute().parent
    shown = _shown(path)
    places = {keys: f"{shown}:{line}" for keys, line in document.lines.items() if keys}
    return Written(with_paths(document.value, folder, str(path)), places), folder


def _shown(path: Path) -> str:
    """A path as short as it can be understood."""
    for folder in (CONFIGS, Path.cwd()):
        if path.is_relative_to(folder):
            return str(path.relative_to(folder))
    return str(path)


def _over_base(
    written: Written, folder: Path | None, above: tuple[Path, ...] = (), preset: Path | None = None
) -> Written:
    """A file's content laid over that of its base, which may have one too, and all over what comes with juicer.

    Args:
        written: The content.
        folder: What its paths are relative to.
        above: Files that it is a base of.
        preset: What all of it starts from instead of the preset at its bottom, if any.

    Raises:
        ConfigError: If a base is missing, or is laid over itself.
    """
    place = written.place((BASE_KEY,)) or BASE_KEY
    found = _find_base(written.values[BASE_KEY], folder, place) if BASE_KEY in written.values else None
    if preset and (found is None or _is_preset(found)):
        found, preset = preset, None
    if found is None:
        return written.over(Written({POLICIES_KEY: defaults()[POLICIES_KEY]}))
    base = _from_file(found)
    above = (*above, found.resolve())
    if len(set(above)) < len(above):
        raise ConfigError(f"{place}: base leads back to '{_shown(found)}', which is laid over this file itself")
    return lay_over(written.without(BASE_KEY), _over_base(*base, above, preset))


def _is_preset(path: Path) -> bool:
    """Whether a path, however it is written, is that of a preset."""
    try:
        return path.resolve().is_relative_to(PRESETS.resolve())
    except (OSError, RuntimeError, ValueError):  # told where the file is read
        return False


def _find_base(text: Any, folder: Path | None, origin: str) -> Path:
    if not isinstance(text, str) or not text:
        raise ConfigError(f"{origin}: base must be the name of a preset, or the path of a file")
    if is_name(text):
        return find_preset(text)
    path = absolute_path(text, folder, origin, BASE_KEY)
    # What the examples show works from any folder.
    return path if _exists(path) else shipped_path(text) or path


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # the name is too long, or a folder may not be looked into
        return False
