"""Critical states labelled by hand: a YAML or CSV file of recording, step and critical state.

A CSV file has the header ``recording,step,critical_state``; a YAML file is a list of mappings with these keys. A
recording is named by its episode id, the beginning of it, or the name of its log; the step is one of the recording,
in which idle steps count: so a label means the same whatever else is ingested, and however.

Files of an earlier juicer have the column ``episode`` instead, a number that shifts with every log that is added, and
steps of the episode. They are refused, and rewritten on demand for the episodes that their numbers are of.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml

from juicer.episode import DemonstrationReader, EpisodeRecord
from juicer.errors import InvalidLabels, did_you_mean
from juicer.reading import read_bounded
from juicer.storage.tables import Annotation
from juicer.text import printable

COLUMNS = ("recording", "step", "critical_state")
NUMBERED_COLUMNS = ("episode", "step", "critical_state")

MOST_BYTES = 2**18
"""Largest labels file: room for thousands of labels."""

SHORTEST_PREFIX = 6
"""Digits of an episode id that may stand for it."""

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
    """Read a labels file, YAML or CSV by its ending.

    Raises:
        InvalidLabels: If the file cannot be read or holds no label, a key is missing, unknown or there twice, a step or
            critical state is no whole number, or a critical state of a recording is labelled twice.
    """
    return _distinct(
        Label(_name(values["recording"], where), *_numbers(values, where), where)
        for where, values in _read(path, COLUMNS)
    )


def read_numbered_labels(path: Path, demonstrations: DemonstrationReader) -> list[Label]:
    """Read a labels file of an earlier juicer, as labels of today.

    Args:
        path: The file, whose columns are ``episode``, ``step`` and ``critical_state``.
        demonstrations: The episodes that it numbers, and whose steps it counts.

    Raises:
        InvalidLabels: See :func:`read_labels`; and if there is no such episode or step.
    """
    labels = []
    for where, values in _read(path, NUMBERED_COLUMNS):
        number = _whole_number(values["episode"], "episode", where)
        step, critical_state = _numbers(values, where)
        if number >= len(demonstrations):
            raise InvalidLabels(
                f"{where}: there is no episode {number}; episodes are numbered 0 to {len(demonstrations) - 1}"
            )
        episode = demonstrations.read(number)
        if step >= len(episode):
            raise InvalidLabels(f"{where}: episode {number} has no step {step}; it has {len(episode)} steps")
        labels.append(Label(episode.record.episode_id, episode.recorded_step(step), critical_state, where))
    return _distinct(labels)


def labels_of(annotations: Iterable[Annotation], demonstrations: DemonstrationReader) -> list[Label]:
    """Annotations as labels, e.g. to correct some of them by hand."""
    numbers = {record.episode_id: number for number, record in enumerate(demonstrations.records)}
    return [
        Label(
            row.episode_id,
            demonstrations.read(numbers[row.episode_id]).recorded_step(row.step),
            row.critical_state,
            row.author,
        )
        for row in annotations
    ]


def write_labels(path: Path, labels: Iterable[Label]) -> None:
    """Write a labels file, YAML or CSV by its ending; one that is there stays as it is.

    Raises:
        InvalidLabels: If the name has another ending, the file exists, or it cannot be written.
    """
    import pandas as pd  # takes half a second

    _check_ending(path)
    table = pd.DataFrame([(label.recording, label.step, label.critical_state) for label in labels], columns=COLUMNS)
    try:
        with path.open("x", newline="") as file:
            if path.suffix == ".csv":
                table.to_csv(file, index=False)
            else:
                yaml.safe_dump(table.to_dict("records"), file, sort_keys=False)
    except FileExistsError:
        raise InvalidLabels(f"labels file '{printable(path)}' exists already; name another") from None
    except OSError as error:
        raise InvalidLabels(f"labels file '{printable(path)}' cannot be written: {error.strerror or error}") from None


def find_recording(label: Label, records: Sequence[EpisodeRecord]) -> int:
    """Number of the demonstration that a label means.

    Raises:
        InvalidLabels: If there is none, or more than one.
    """
    name = label.recording
    is_prefix = len(name) >= SHORTEST_PREFIX
    found = [
        number
        for number, record in enumerate(records)
        if record.log == name or (is_prefix and record.episode_id.startswith(name))
    ]
    if len(found) > 1:
        ids = ", ".join(records[number].episode_id for number in found[:_FEW])
        raise InvalidLabels(f"{label.where}: '{name}' names {len(found)} recordings, {ids}; write the whole id of one")
    if not found:
        known = [record.log or record.episode_id for record in records]
        near = did_you_mean(name, known) if len(known) <= _FEW or get_close_matches(name, known, n=1) else ""
        raise InvalidLabels(f"{label.where}: there is no demonstration of a recording '{name}'{near}")
    return found[0]


def _read(path: Path, columns: Sequence[str]) -> list[tuple[str, dict[str, str]]]:
    """Place and values of every label in a file."""
    reader = _check_ending(path)
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


def _check_ending(path: Path) -> Any:
    """What reads files of this ending."""
    readers = {".csv": _read_csv, ".yaml": _read_yaml, ".yml": _read_yaml}
    if path.suffix not in readers:
        raise InvalidLabels(f"labels file '{printable(path)}' must end in .csv, .yaml or .yml")
    return readers[path.suffix]


def _distinct(labels: Iterable[Label]) -> list[Label]:
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


def _numbers(values: Mapping[str, str], where: str) -> tuple[int, int]:
    """Step and critical state."""
    return (
        _whole_number(values["step"], "step", where),
        _whole_number(values["critical_state"], "critical_state", where),
    )


def _whole_number(text: str, key: str, where: str) -> int:
    digits = text.strip()
    if not digits.isdecimal():
        raise InvalidLabels(f"{where}: '{key}' must be a whole number, got '{printable(text)}'")
    if len(digits) > _MOST_DIGITS:
        raise InvalidLabels(f"{where}: '{key}' is too large a number, it has {len(digits)} digits")
    return int(digits)
