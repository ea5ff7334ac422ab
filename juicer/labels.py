"""Critical states labelled by hand: a YAML or CSV file of episode, step and critical state.

A CSV file has the header ``episode,step,critical_state``; a YAML file is a list of mappings with these keys.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from juicer.errors import InvalidLabels, did_you_mean

COLUMNS = ("episode", "step", "critical_state")


@dataclass(frozen=True)
class Label:
    """What a human said about one critical state.

    Attributes:
        episode: Number of the episode in its artifact.
        step: Step just before the critical interaction.
        critical_state: Index of the critical state, from 0.
        where: File and place in it, for error messages.
    """

    episode: int
    step: int
    critical_state: int
    where: str


def read_labels(path: Path) -> list[Label]:
    """Read a labels file, YAML or CSV by its ending.

    Raises:
        InvalidLabels: If the file cannot be read, a key is missing or unknown, a value is no whole number,
            or a critical state of an episode is labelled twice.
    """
    readers = {".csv": _read_csv, ".yaml": _read_yaml, ".yml": _read_yaml}
    if path.suffix not in readers:
        raise InvalidLabels(f"labels file '{path}' must end in .csv, .yaml or .yml")
    try:
        rows = readers[path.suffix](path)
    except FileNotFoundError:
        raise InvalidLabels(f"labels file '{path}' does not exist") from None
    except (OSError, UnicodeDecodeError, csv.Error, yaml.YAMLError) as error:
        raise InvalidLabels(f"labels file '{path}' cannot be read: {' '.join(str(error).split())}") from None
    labels = [_label(row, f"{path.name}, {where}") for where, row in rows]
    seen: dict[tuple[int, int], Label] = {}
    for label in labels:
        other = seen.setdefault((label.episode, label.critical_state), label)
        if other is not label:
            raise InvalidLabels(
                f"{label.where}: critical state {label.critical_state} of episode {label.episode} "
                f"was already labelled at {other.where}; keep one of the two"
            )
    return labels


def _read_csv(path: Path) -> list[tuple[str, Any]]:
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file, skipinitialspace=True)
        return [(f"line {reader.line_num}", row) for row in reader]


def _read_yaml(path: Path) -> list[tuple[str, Any]]:
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    if not isinstance(content, list):
        raise InvalidLabels(f"labels file '{path}' must hold a list of entries with the keys {', '.join(COLUMNS)}")
    return [(f"entry {number}", row) for number, row in enumerate(content, start=1)]


def _label(row: Any, where: str) -> Label:
    if not isinstance(row, Mapping):
        raise InvalidLabels(f"{where}: expected the keys {', '.join(COLUMNS)}, got {row!r}")
    for key in row:
        if key not in COLUMNS:
            raise InvalidLabels(f"{where}: unknown key '{key}'{did_you_mean(str(key), COLUMNS)}")
    values = {key: _whole_number(row.get(key), key, where) for key in COLUMNS}
    return Label(**values, where=where)


def _whole_number(value: Any, key: str, where: str) -> int:
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    if isinstance(value, str) and value.strip().isdecimal():
        return int(value)
    if value is None:
        raise InvalidLabels(f"{where}: '{key}' is missing")
    raise InvalidLabels(f"{where}: '{key}' must be a whole number, got {value!r}")
