"""Where plug-ins branch off: of what could be imported there, only what a configuration names counts.

A junction is a package whose folders are its members, one a kind. Source that looks a member up by its name, or lists
all of them, does not depend on each; what a call depends on are the members whose configurations it was given. A member
from outside juicer announces itself by an entry point, and counts in the same way. So does what draws images: nothing
imports it, and a call to which a view was given depends on it.
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

LOADED_BY_NAME = "juicer.imaging"
"""Package that nothing imports which could do without images."""

IMPLEMENTATIONS = ("network", "renderer")
"""Class attributes by which a configuration names what is built of it, or draws it, as ``module:name``."""


def is_plugin(module: str) -> bool:
    """Whether a module lies below a junction, is loaded by name, or comes from outside."""
    inside = tuple(f"{package}." for package in (*JUNCTIONS, LOADED_BY_NAME))
    return module.startswith(inside) or module.partition(".")[0] not in OURS


def plugins_in(config: BaseModel) -> set[str]:
    """What a configuration and those within it choose: members of junctions, modules from outside, what draws."""
    return {
        _member_of(module) or module
        for model in models_in(config)
        for each in type(model).__mro__
        if issubclass(each, StrictConfig)
        for module in (each.__module__, *_named_by(each))
        if is_plugin(module)
    }


def _named_by(model: type[StrictConfig]) -> list[str]:
    """Modules of what a class of configurations names."""
    named = (vars(model).get(name) for name in IMPLEMENTATIONS)
    return [name.partition(":")[0] for name in named if isinstance(name, str)]


def _member_of(module: str) -> str | None:
    for junction in JUNCTIONS:
        if module.startswith(f"{junction}."):
            return ".".join(module.split(".")[: junction.count(".") + 2])
    return None
