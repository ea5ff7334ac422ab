"""Critical states labelled by hand: a CSV, YAML or JSON lines file of recording, step and critical state.

A CSV file has the header ``recording,step,critical_state``; a YAML file is a list of mappings with these keys, and in a
file of JSON lines every line is one. A recording is named by its episode id, the beginning of it, or the name of its
log; the step is one of the recording, in which idle steps count: so a label means the same whatever else is ingested,
and however.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml

from juicer.episode import EpisodeRecord, episodes_named
from juicer.errors import InvalidLabels, did_you_mean
from juicer.reading import read_bounded
from juicer.text import printable

COLUMNS = ("recording", "step", "critical_state")
NUMBERED_COLUMNS = ("episode", "step", "critical_state")

MOST_BYTES = 2**18
"""Largest labels file: room for thousands of labels."""

_FEW = 10
_MOST_DIGITS = 9
_DEEPEST = 3
"""A document, its list, and the mappings in it."""
_SEPARATORS = {";": "semicolons", "\t": "tabs"}
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

Row = tuple[str, list[tuple[str, str]]]
"""Place in the file, and its keys and values."""


@dataclass(frozen=True)
class Label:
    """What a human said about one critical state.

    Attributes:
        recording: Episode id, the beginning of one, or the name of a log.
        step: Step of the recording just before the critical interaction; idle steps count.
        critical_state: Index of the critical state, from 0.
        where: File and place in it, for error messages.
    """

    recording: str
    step: int
    critical_state: int
    where: str


def read_labels(path: Path) -> list[Label]:
    """Read a labels file, of the format that its ending names.

    Raises:
        InvalidLabels: If the file cannot be read or holds no label, a key is missing, unknown or there twice, a step or
            critical state is not a whole number, or a critical state of a recording is labelled twice.
    """
    return distinct(
        Label(_name(values["recording"], where), *step_and_state(values, where), where)
        for where, values in read_rows(path, COLUMNS)
    )


def find_recording(label: Label, records: Sequence[EpisodeRecord]) -> int:
    """Number of the demonstration that a label means.

    Raises:
        InvalidLabels: If there is none, or more than one.
    """
    name = label.recording
    found = episodes_named(name, records)
    if len(found) > 1:
        ids = ", ".join(records[number].episode_id for number in found[:_FEW])
        raise InvalidLabels(f"{label.where}: '{name}' names {len(found)} recordings, {ids}; write the whole id of one")
    if not found:
        known = [record.log or record.episode_id for record in records]
        near = did_you_mean(name, known) if len(known) <= _FEW or get_close_matches(name, known, n=1) else ""
        raise InvalidLabels(f"{label.where}: there is no demonstration of a recording '{name}'{near}")
    return found[0]


def read_rows(path: Path, columns: Sequence[str]) -> list[tuple[str, dict[str, str]]]:
    """Place and values of every label in a file that has these columns.

    Raises:
        InvalidLabels: See :func:`read_labels`.
    """
    reader = reader_of(path)
    name = printable(path)
    try:
        text = read_bounded(path, MOST_BYTES).decode("utf-8-sig")
        rows = list(reader(text, name, columns))
    except FileNotFoundError:
        raise InvalidLabels(f"labels file '{name}' does not exist") from None
    except UnicodeDecodeError:
        raise InvalidLabels(f"labels file '{name}' is not UTF-8 text; save it as UTF-8") from None
    except OSError as error:
        raise InvalidLabels(f"labels file '{name}' cannot be read: {error.strerror or error}") from None
    except (csv.Error, yaml.YAMLError, RecursionError) as error:
        raise InvalidLabels(f"labels file '{name}' cannot be read: {printable(' '.join(str(error).split()))}") from None
    if not rows:
        raise InvalidLabels(f"labels file '{name}' holds no label; leave it out if there is nothing to label")
    placed = [(f"{printable(path.name)}, {where}", row) for where, row in rows]
    for where, row in placed:
        _check_keys([key for key, _ in row], columns, where)
    return [(where, dict(row)) for where, row in placed]


def reader_of(path: Path) -> Any:
    """What reads files of this ending.

    Raises:
        InvalidLabels: If nothing does.
    """
    readers = {".csv": _read_csv, ".yaml": _read_yaml, ".yml": _read_yaml, ".jsonl": _read_json_lines}
    if path.suffix not in readers:
        raise InvalidLabels(f"labels file '{printable(path)}' must end in .csv, .jsonl, .yaml or .yml")
    return readers[path.suffix]


def distinct(labels: Iterable[Label]) -> list[Label]:
    """Labels as they are.

    Raises:
        InvalidLabels: If a critical state of a recording is labelled twice.
    """
    seen: dict[tuple[str, int], Label] = {}
    for label in labels:
        other = seen.setdefault((label.recording, label.critical_state), label)
        if other is not label:
            raise InvalidLabels(
                f"{label.where}: critical state {label.critical_state} of recording {label.recording} "
                f"was already labelled at {other.where}; keep one of the two"
            )
    return list(seen.values())


def _read_csv(text: str, name: str, expected: Sequence[str]) -> Iterator[Row]:
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True, strict=True)
    columns: list[str] | None = None
    for values in reader:
        if not any(value.strip() for value in values):
            continue
        where = f"line {reader.line_num}"
        if columns is None:
            columns = [value.strip() for value in values]
            _check_columns(columns, expected, f"{name}, {where}")
        elif len(values) != len(columns):
            raise InvalidLabels(f"{name}, {where}: {len(columns)} values are needed, got {len(values)}")
        else:
            yield where, list(zip(columns, values, strict=True))


def _check_columns(columns: list[str], expected: Sequence[str], where: str) -> None:
    """A table that begins with a label instead of its columns would lose that label."""
    if len(columns) == 1:
        for separator, words in _SEPARATORS.items():
            if separator in columns[0]:
                raise InvalidLabels(f"{where}: its values are separated by {words}; separate them by commas")
    if any(column.isdecimal() for column in columns):
        raise InvalidLabels(
            f"{where}: it must name the columns {','.join(expected)}, got {printable(','.join(columns))}"
        )
    _check_keys(columns, expected, where)


def _read_yaml(text: str, name: str, expected: Sequence[str]) -> Iterator[Row]:
    keys = ", ".join(expected)
    _check_events(text, name)
    root = yaml.compose(text, _Loader)
    if root is None:
        return
    if not isinstance(root, yaml.SequenceNode):
        raise InvalidLabels(f"labels file '{name}' must hold a list of entries with the keys {keys}")
    for number, entry in enumerate(root.value, start=1):
        where = f"entry {number}"
        if not isinstance(entry, yaml.MappingNode):
            raise InvalidLabels(f"{name}, {where}: expected the keys {keys}, got {_shown(entry)}")
        for _, value in entry.value:
            if not isinstance(value, yaml.ScalarNode):
                raise InvalidLabels(f"{name}, {where}: every value must be a text or a number, got {_shown(value)}")
        # Values as they are written: an id such as 1e10 is no number.
        yield where, [(_shown(key), value.value) for key, value in entry.value]


def _read_json_lines(text: str, name: str, expected: Sequence[str]) -> Iterator[Row]:
    for number, line in enumerate(text.split("\n"), start=1):
        where = f"line {number}"
        if not line.strip():
            continue
        try:
            pairs = json.loads(line, object_pairs_hook=_Pairs, parse_int=str)
        except (ValueError, RecursionError) as error:
            raise InvalidLabels(f"{name}, {where}: it is not JSON: {printable(error)}") from None
        if not isinstance(pairs, _Pairs):
            raise InvalidLabels(f"{name}, {where}: expected the keys {', '.join(expected)}, got {printable(line)}")
        for key, value in pairs:
            if not isinstance(value, str | int) or isinstance(value, bool):
                raise InvalidLabels(f"{name}, {where}: '{printable(key)}' must be a text or a whole number")
        yield where, [(printable(key), str(value)) for key, value in pairs]


class _Pairs(list[tuple[str, Any]]):
    """Keys and values of a JSON object, also those that are there twice."""


def _check_events(text: str, name: str) -> None:
    """Refuse what a tree could not be built of in reasonable time; events come one by one."""
    depth = 0
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.AliasEvent):
            raise InvalidLabels(f"labels file '{name}' refers to another part of itself (*); write every value out")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise InvalidLabels(f"labels file '{name}' is nested too deeply; it is a list of entries")


def _shown(node: yaml.Node) -> str:
    return printable(node.value) if isinstance(node, yaml.ScalarNode) else f"a {node.tag.rpartition(':')[2]}"


def _check_keys(keys: list[str], expected: Sequence[str], where: str) -> None:
    if set(keys) == set(NUMBERED_COLUMNS) != set(expected):
        raise InvalidLabels(
            f"{where}: it numbers episodes, and a number means another demonstration once a log is added; "
            "`juicer labels EPISODES NEW --numbered THIS` writes it anew with the ids of the recordings"
        )
    for key in keys:
        if key not in expected:
            raise InvalidLabels(f"{where}: unknown key '{printable(key)}'{did_you_mean(key, expected)}")
        if keys.count(key) > 1:
            raise InvalidLabels(f"{where}: '{key}' is there twice")
    for column in expected:
        if column not in keys:
            raise InvalidLabels(f"{where}: '{column}' is missing")


def _name(text: str, where: str) -> str:
    name = text.strip()
    if not name or printable(name) != name:
        raise InvalidLabels(f"{where}: 'recording' must name an episode or a log, got '{printable(text)}'")
    return name


def step_and_state(values: Mapping[str, str], where: str) -> tuple[int, int]:
    """Step and critical state of a label.

    Raises:
        InvalidLabels: If one of them is not a whole number.
    """
    return (
        whole_number(values["step"], "step", where),
        whole_number(values["critical_state"], "critical_state", where),
    )


def whole_number(text: str, key: str, where: str) -> int:
    """A value as a number.

    Raises:
        InvalidLabels: If it is no whole, decimal number, or too large.
    """
    digits = text.strip()
    if not digits.isdecimal():
        raise InvalidLabels(f"{where}: '{key}' must be a whole number, got '{printable(text)}'")
    if len(digits) > _MOST_DIGITS:
        raise InvalidLabels(f"{where}: '{key}' is too large a number, it has {len(digits)} digits")
    return int(digits)
