"""Where plug-ins branch off: of what could be imported there, only what a configuration names counts.

A junction is a package whose folders are its members, one a kind. Source that looks a member up by its name, or lists
all of them, does not depend on each; what a call depends on are the members whose configurations it was given. A member
from outside juicer announces itself by an entry point, and counts in the same way.
"""

from __future__ import annotations

from pydantic import BaseModel

from juicer.config import StrictConfig, models_in

JUNCTIONS = (
    "juicer.policy.backbones",
    "juicer.policy.encoders",
    "juicer.policy.heads",
    "juicer.policy.denoisers",
)
"""All of them. What the members of one share lies beside their folders, or elsewhere, and is followed like any code."""

OURS = ("juicer", "stages")
"""Packages whose source counts, beside that of what is a stage or a plug-in; all else counts by its version."""

IMPLEMENTATION = "network"
"""Class attribute by which a configuration names what is built of it, as ``module:name``."""


def is_plugin(module: str) -> bool:
    """Whether a module lies below a junction or comes from outside."""
    return module.startswith(tuple(f"{junction}." for junction in JUNCTIONS)) or module.partition(".")[0] not in OURS


def plugins_in(config: BaseModel) -> set[str]:
    """What a configuration and those within it choose: members of junctions, and modules from outside."""
    return {
        _member_of(module) or module
        for model in models_in(config)
        for each in type(model).__mro__
        if issubclass(each, StrictConfig)
        for module in (each.__module__, str(vars(each).get(IMPLEMENTATION, "")).partition(":")[0])
        if module and is_plugin(module)
    }


def _member_of(module: str) -> str | None:
    for junction in JUNCTIONS:
        if module.startswith(f"{junction}."):
            return ".".join(module.split(".")[: junction.count(".") + 2])
    return None
