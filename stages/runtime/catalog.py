"""Every stage by name, imported when it is asked for."""

from __future__ import annotations

import importlib
from typing import Any

from juicer.announced import announced, load
from juicer.errors import ConfigError, did_you_mean
from juicer.text import printable
from stages.runtime.names import STAGES
from stages.runtime.stage import Stage

GROUP = "juicer.stages"
"""Entry points of stages from other packages: the name is the stage's, the object the stage."""


def find_stage(name: str) -> Stage[Any]:
    """Stage of a name: one of ours, or one that another package announces by an entry point.

    Raises:
        ConfigError: If there is none, or what announces it is broken.
    """
    if name in STAGES:
        stage: Stage[Any] = getattr(importlib.import_module(f"stages.{name}"), name)
        return stage
    others = announced(GROUP)
    if name not in others:
        raise ConfigError(f"unknown stage '{printable(name)}'{did_you_mean(name, (*STAGES, *others))}")

    def problem_of(found: object) -> str:
        return "" if isinstance(found, Stage) and found.name == name else "it is not a stage of that name"

    found: Stage[Any] = load(others[name], "stage", problem_of)
    return found
