"""Golden values on disk: one file, by environment and name."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

PATH = Path(__file__).with_name("values.json")

Values = Mapping[str, Mapping[str, Any]]
"""By environment, then by name of the case."""


def load_values() -> Values:
    """All that were recorded."""
    values: Values = json.loads(PATH.read_text()) if PATH.exists() else {}
    return values


def save_values(values: Values) -> None:
    """Replace all."""
    PATH.write_text(json.dumps(values, indent=1) + "\n")


def merged(old: Values, new: Values) -> Values:
    """New values beside those of other environments.

    If a value has changed within an environment, other environments' values of the same name are out of date too, and
    are dropped.
    """
    changed = {
        name
        for environment, cases in new.items()
        for name, value in cases.items()
        if old.get(environment, {}).get(name, value) != value
    }
    others = {
        environment: {name: value for name, value in cases.items() if name not in changed}
        for environment, cases in old.items()
    }
    return {environment: cases for environment, cases in {**others, **new}.items() if cases}
