"""Every stage by name, imported when it is asked for."""

from __future__ import annotations

import importlib
from typing import Any

from juicer.errors import ConfigError, did_you_mean
from stages.stage import Stage

STAGES = ("record", "ingest", "annotate", "augment", "train", "collect", "select", "evaluate", "report")
"""In the order of the loop."""


def find_stage(name: str) -> Stage[Any]:
    """Stage of a name.

    Raises:
        ConfigError: If there is none.
    """
    if name not in STAGES:
        raise ConfigError(f"unknown stage '{name}'{did_you_mean(name, STAGES)}")
    stage: Stage[Any] = getattr(importlib.import_module(f"stages.{name}"), name)
    return stage
