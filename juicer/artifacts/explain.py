"""Why a recipe has no artifact yet: what differs from the most similar artifact that there is."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore

Part = Literal["inputs", "config", "code", "files", "libraries"]
Change = Literal["added", "removed", "changed"]


@dataclass(frozen=True)
class Difference:
    """One thing that two recipes do not share.

    Attributes:
        part: Part of the recipe.
        key: Role, dotted config key, module, file label or library.
        change: What happened to it since the artifact that exists.
        old: Its value there; none if it was added.
        new: Its value in the recipe at hand; none if it was removed.
    """

    part: Part
    key: str
    change: Change
    old: Any
    new: Any

    @property
    def sentence(self) -> str:
        """The difference in words."""
        thing = f"{_NOUNS[self.part]} '{self.key}'"
        # The hashes of code and files would tell a reader nothing.
        told = self.part not in ("code", "files")
        if self.change == "added":
            return f"{thing} is new" + (f": {_shown(self.new)}" if told else "")
        if self.change == "removed":
            return f"{thing} is gone" + (f", it was {_shown(self.old)}" if told else "")
        return f"{thing} " + (f"is {_shown(self.new)}, it was {_shown(self.old)}" if told else "changed")


@dataclass(frozen=True)
class Explanation:
    """Whether a recipe has an artifact, and if not, why.

    Attributes:
        ref: The artifact the recipe makes.
        hit: Whether it exists.
        nearest: The most similar artifact of the stage; none if the stage never ran, or at a hit.
        differences: What keeps the recipe from being that of ``nearest``.
    """

    ref: ArtifactRef
    hit: bool
    nearest: Manifest | None = None
    differences: tuple[Difference, ...] = ()

    @property
    def sentences(self) -> list[str]:
        """The explanation in words, the conclusion first."""
        if self.hit:
            return [f"{self.ref} exists and would be reused"]
        if self.nearest is None:
            return [f"{self.ref} does not exist, and the stage has made no artifact before"]
        nearest = f"the nearest is {self.nearest.ref} of {self.nearest.finished}"
        return [f"{self.ref} does not exist; {nearest}", *(difference.sentence for difference in self.differences)]


def explain(store: ArtifactStore, recipe: Recipe) -> Explanation:
    """Say whether a recipe would hit, and if not, how it differs from the nearest artifact of the same stage.

    The nearest has the fewest differences; among equals, the newest.
    """
    if store.find(recipe) is not None:
        return Explanation(recipe.ref, hit=True)
    compared = [
        (manifest, tuple(compare(manifest.recipe, recipe)))
        for manifest in reversed(store.list(recipe.kind))
        if manifest.recipe.stage == recipe.stage
    ]
    if not compared:
        return Explanation(recipe.ref, hit=False)
    nearest, differences = min(compared, key=lambda candidate: len(candidate[1]))
    return Explanation(recipe.ref, False, nearest, differences)


def compare(old: Recipe, new: Recipe) -> Iterator[Difference]:
    """Every difference between two recipes of one stage."""
    yield from _differences("inputs", _named(old.inputs), _named(new.inputs))
    yield from _differences("config", _flat(old.config), _flat(new.config))
    if old.code != new.code:
        changed = list(_differences("code", old.modules, new.modules))
        # Without module versions there is only the version of the whole.
        yield from changed or [Difference("code", new.stage, "changed", old.code, new.code)]
    yield from _differences("files", old.files, new.files)
    yield from _differences("libraries", old.libraries, new.libraries)


_NOUNS: Mapping[Part, str] = {
    "inputs": "input",
    "config": "config key",
    "code": "code of",
    "files": "file",
    "libraries": "library",
}


def _differences(part: Part, old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[Difference]:
    for key in sorted(old.keys() | new.keys()):
        if key not in old:
            yield Difference(part, key, "added", None, new[key])
        elif key not in new:
            yield Difference(part, key, "removed", old[key], None)
        elif old[key] != new[key]:
            yield Difference(part, key, "changed", old[key], new[key])


def _named(inputs: Mapping[str, Sequence[ArtifactRef]]) -> dict[str, list[str]]:
    return {role: [str(ref) for ref in refs] for role, refs in inputs.items()}


def _flat(config: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Leaves of nested mappings by dotted key."""
    flat: dict[str, Any] = {}
    for key, value in config.items():
        if isinstance(value, Mapping) and value:
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def _shown(value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, list) and all(isinstance(item, str) for item in value):
        return ", ".join(value)
    return json.dumps(value)
