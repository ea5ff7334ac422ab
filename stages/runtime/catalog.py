"""Every stage by name, imported when it is asked for."""

from __future__ import annotations

import importlib
from typing import Any

from juicer.errors import ConfigError, did_you_mean
from stages.runtime.names import STAGES
from stages.runtime.stage import Stage


def find_stage(name: str) -> Stage[Any]:
    """Stage of a name.

    Raises:
        ConfigError: If there is none.
    """
    if name not in STAGES:
        raise ConfigError(f"unknown stage '{name}'{did_you_mean(name, STAGES)}")
    stage: Stage[Any] = getattr(importlib.import_module(f"stages.{name}"), name)
    return stage
