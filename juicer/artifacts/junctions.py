"""Where plug-ins branch off: of what could be imported there, only what a configuration names counts.

A junction is a package whose folders are its members, one a kind. Source that looks a member up by its name, or lists
all of them, does not depend on each; what a call depends on are the members whose configurations it was given. A member
from outside juicer announces itself by an entry point, and counts in the same way.
"""

from __future__ import annotations

from pydantic import BaseModel

from juicer.config import models_in

JUNCTIONS = (
    "juicer.policy.encoders",
    "juicer.policy.heads",
    "juicer.policy.denoisers",
)
"""All of them. What the members of one share lies beside their folders, or elsewhere, and is followed like any code."""

IMPLEMENTATION = "network"
"""Class attribute by which a configuration names what is built of it, as ``module:name``."""


def member_of(module: str) -> str | None:
    """The member of a junction that a module belongs to: ``juicer.policy.heads.mlp`` of ``…mlp.network``."""
    for junction in JUNCTIONS:
        if module.startswith(f"{junction}."):
            return ".".join(module.split(".")[: junction.count(".") + 2])
    return None


def plugins_in(config: BaseModel, first_party: tuple[str, ...]) -> set[str]:
    """What a configuration chooses: members of junctions, and modules of plug-ins from outside.

    Args:
        config: A configuration; those within it are looked at too.
        first_party: Packages from which only members of junctions are plug-ins.
    """
    found: set[str] = set()
    for model in models_in(config):
        for each in type(model).__mro__:
            implementation = str(vars(each).get(IMPLEMENTATION, "")).partition(":")[0]
            for module in filter(None, (each.__module__, implementation)):
                if member := member_of(module):
                    found.add(member)
                elif issubclass(each, BaseModel) and module.partition(".")[0] not in (*first_party, "pydantic"):
                    found.add(module)
    return found
