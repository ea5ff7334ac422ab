"""Why a recipe has no artifact yet: what changed since the most similar artifact, down to the root of the change.

An artifact is missed because of its own settings, code or libraries, or because something it is made from is missed.
The second kind is followed upstream, so that one changed key is told once, however many artifacts hang on it.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError

Part = Literal["inputs", "config", "tasks", "code", "files", "libraries"]
SHARED: tuple[Part, ...] = ("code", "libraries", "tasks")
"""Parts whose differences are the same whichever stage has them."""
Change = Literal["added", "removed", "changed"]

IDENTITY_KEYS = frozenset({"task", "seed"})
"""Last words of configuration keys that say which artifact it is rather than how it is made."""


@dataclass(frozen=True)
class Difference:
    """One thing that two recipes do not share.

    Attributes:
        part: Part of the recipe.
        key: Role, dotted config key, task and dotted entry, module, file label or library.
        change: What happened to it since the artifact that exists.
        old: Its value there; none if it was added.
        new: Its value in the recipe at hand; none if it was removed.
    """

    part: Part
    key: str
    change: Change
    old: Any
    new: Any

    @cached_property
    def identity(self) -> str:
        """Text that only equal differences share; their values need not be hashable."""
        return json.dumps([self.part, self.key, self.change, self.old, self.new])

    @property
    def sentence(self) -> str:
        """The difference in words."""
        thing = f"task {self.key}" if self.part == "tasks" else f"{_NOUNS[self.part]} '{self.key}'"
        # The hashes of code and files would tell a reader nothing.
        told = self.part not in ("code", "files")
        if self.change == "added":
            return f"{thing} is new" + (f": {_shown(self.new)}" if told else "")
        if self.change == "removed":
            return f"{thing} is gone" + (f", it was {_shown(self.old)}" if told else "")
        return f"{thing} " + (f"is {_shown(self.new)}, it was {_shown(self.old)}" if told else "changed")


@dataclass(frozen=True)
class Cause:
    """A difference at the root of a miss.

    Attributes:
        stage: The stage that has it.
        section: Where its settings are in a configuration.
        difference: What it is.
        consequences: Stages that are computed again because of it, upstream first, down to the one asked about.
    """

    stage: str
    section: str
    difference: Difference
    consequences: tuple[str, ...] = ()

    @property
    def phrase(self) -> str:
        """The difference in words; settings under the name of their section, inputs and files under their stage's."""
        if self.difference.part in SHARED:
            return self.difference.sentence
        place = self.section if self.difference.part == "config" else self.stage
        return replace(self.difference, key=f"{place}.{self.difference.key}").sentence

    @property
    def is_of_shape(self) -> bool:
        """Whether one is made from more than the other, rather than from another version of the same."""
        return self.difference.part == "inputs" and self.difference.change != "changed"

    @property
    def is_of_identity(self) -> bool:
        """Whether it says that the two are of different tasks or seeds."""
        return self.difference.part == "config" and self.difference.key.rpartition(".")[2] in IDENTITY_KEYS


@dataclass(frozen=True)
class Explanation:
    """Whether a recipe has an artifact, and if not, why.

    Attributes:
        ref: The artifact the recipe makes.
        stage: The stage that makes it.
        hit: Whether it exists.
        nearest: The most similar artifact of the stage; none if the stage never ran, or at a hit.
        causes: What keeps the recipe from being that of ``nearest``, each root once.
    """

    ref: ArtifactRef
    stage: str
    hit: bool
    nearest: Manifest | None = None
    causes: tuple[Cause, ...] = ()

    @property
    def reasons(self) -> list[str]:
        """The causes in words, with what follows from each; modules that changed together in one sentence."""
        reasons: list[str] = []
        modules: dict[tuple[Change, str], list[str]] = {}
        for cause in self.causes:
            if cause.difference.part == "code":
                modules.setdefault((cause.difference.change, self._so(cause)), []).append(cause.difference.key)
            else:
                reasons.append(cause.phrase + self._so(cause))
        for (change, so), names in modules.items():
            reasons.append(Difference("code", "', '".join(sorted(names)), change, None, None).sentence + so)
        return reasons

    @property
    def sentences(self) -> list[str]:
        """The explanation in words, the conclusion first."""
        if self.hit:
            return [f"{self.ref} exists and would be reused"]
        if self.nearest is None:
            return [f"{self.ref} does not exist, and the stage has made no artifact before"]
        nearest = f"the nearest is {self.nearest.ref} of {self.nearest.finished}"
        return [f"{self.ref} does not exist; {nearest}", *self.reasons]

    def _so(self, cause: Cause) -> str:
        if cause.stage == self.stage:
            return ""
        *first, last = cause.consequences
        names = f"{', '.join(first)} and {last}" if first else last
        return f", so {names} {'are' if first else 'is'} computed again"


def explain(store: ArtifactStore, recipe: Recipe, planned: Collection[Recipe] = ()) -> Explanation:
    """Say whether a recipe would hit, and if not, why; see :class:`Explainer`."""
    return Explainer(store, planned).explain(recipe)


class Explainer:
    """Explains the misses of one plan; reads every manifest once."""

    def __init__(
        self,
        store: ArtifactStore,
        planned: Collection[Recipe] = (),
        sections: Mapping[ArtifactRef, str] = MappingProxyType({}),
    ) -> None:
        """Start with nothing read.

        Args:
            store: Where the artifacts are.
            planned: Recipes of the same run: what its artifacts will be made from need not exist yet.
            sections: Where the settings of planned artifacts are in a configuration, if not under their stage's name.
        """
        self._store = store
        self._sections = sections
        self._planned = {recipe.ref: recipe for recipe in planned}
        self._recipes: dict[ArtifactRef, Recipe | None] = dict(self._planned)
        # By references: an id is a hash, and to compute it takes longer than to compare.
        self._manifests: dict[str, dict[ArtifactRef, Manifest]] = {}
        self._causes: dict[tuple[ArtifactRef, ArtifactRef], tuple[Cause, ...]] = {}

    def explain(self, recipe: Recipe) -> Explanation:
        """Say whether a recipe would hit, and if not, how it differs from the nearest artifact of the same stage.

        The nearest is made from the same kinds of things, is of the same task and seed, is not what the run uses in
        another place, and has the fewest changes in itself and its ancestors, in this order; among equals, the newest.
        """
        ref = recipe.ref
        if self._store.find(recipe) is not None:
            return Explanation(ref, recipe.stage, hit=True)
        self._recipes[ref] = recipe
        candidates = self._candidates(recipe)
        if not candidates:
            return Explanation(ref, recipe.stage, hit=False)
        compared = {old: self._between(old, manifest.recipe, ref, recipe) for old, manifest in candidates.items()}
        nearest = min(compared, key=lambda old: self._distance(old, compared[old]))
        causes = tuple(sorted(compared[nearest], key=_rank))
        return Explanation(ref, recipe.stage, False, candidates[nearest], causes)

    def _candidates(self, recipe: Recipe) -> dict[ArtifactRef, Manifest]:
        """Artifacts of the same stage, newest first."""
        if recipe.kind not in self._manifests:
            manifests = {manifest.ref: manifest for manifest in reversed(self._store.list(recipe.kind))}
            self._manifests[recipe.kind] = manifests
            self._recipes |= {ref: manifest.recipe for ref, manifest in manifests.items()}
        manifests = self._manifests[recipe.kind]
        return {ref: manifest for ref, manifest in manifests.items() if manifest.recipe.stage == recipe.stage}

    def _distance(self, ref: ArtifactRef, causes: Sequence[Cause]) -> tuple[int, int, bool, int]:
        return (
            sum(cause.is_of_shape for cause in causes),
            sum(cause.is_of_identity for cause in causes),
            ref in self._planned,
            len(causes),
        )

    def _between(self, old_ref: ArtifactRef, old: Recipe, new_ref: ArtifactRef, new: Recipe) -> tuple[Cause, ...]:
        """What changed from one recipe of a stage to another, each root once."""
        key = (old_ref, new_ref)
        if key not in self._causes:
            upstream: dict[tuple[str, str], Cause] = {}
            own: list[Difference] = []
            for role in sorted(old.inputs.keys() | new.inputs.keys()):
                for before, after in self._paired(old.inputs.get(role, ()), new.inputs.get(role, ())):
                    was, will_be = self._recipe(before), self._recipe(after)
                    if before is None or after is None or was is None or will_be is None:
                        own.append(self._of_input(role, before, after))
                        continue
                    for cause in self._between(before, was, after, will_be):
                        _add(upstream, cause)
            # After all that is upstream, so that consequences come in their order.
            found = {
                place: replace(cause, consequences=_joined(cause.consequences, (new.stage,)))
                for place, cause in upstream.items()
            }
            own += [difference for difference in compare(old, new) if difference.part != "inputs"]
            for difference in own:
                shared = difference.part in SHARED
                section = self._sections.get(new_ref, new.stage)
                _add(found, Cause(new.stage, section, difference, (new.stage,) if shared else ()))
            self._causes[key] = tuple(found.values())
        return self._causes[key]

    def _of_input(self, role: str, before: ArtifactRef | None, after: ArtifactRef | None) -> Difference:
        """That an input is new, or gone, or that it cannot be told what it was made of."""
        if before is None or after is None:
            change: Change = "added" if before is None else "removed"
            return Difference("inputs", role, change, self._told(before), self._told(after))
        return Difference("inputs", role, "changed", str(before), str(after))

    def _paired(
        self, old: Sequence[ArtifactRef], new: Sequence[ArtifactRef]
    ) -> Iterator[tuple[ArtifactRef | None, ArtifactRef | None]]:
        """Inputs that differ, each beside what it takes the place of: made by the same stage, as far as is known."""
        left = [ref for ref in old if ref not in new]
        for ref in new:
            if ref in old:
                continue
            stages = [self._stage(other) for other in left]
            wanted = self._stage(ref)
            place = stages.index(wanted) if wanted in stages else None
            if place is None and None in stages and left[stages.index(None)].kind == ref.kind:
                place = stages.index(None)
            yield (None if place is None else left.pop(place)), ref
        for ref in left:
            yield ref, None

    def _stage(self, ref: ArtifactRef) -> str | None:
        recipe = self._recipe(ref)
        return None if recipe is None else recipe.stage

    def _recipe(self, ref: ArtifactRef | None) -> Recipe | None:
        """What an artifact is or will be made of; none if it is gone and no longer planned."""
        if ref is None:
            return None
        if ref not in self._recipes:
            try:
                self._recipes[ref] = self._store.manifest(ref).recipe
            except ArtifactError:
                self._recipes[ref] = None
        return self._recipes[ref]

    def _told(self, ref: ArtifactRef | None) -> str | None:
        if ref is None:
            return None
        stage = self._stage(ref)
        return f"{ref}, made by {stage}" if stage else str(ref)


def _add(found: dict[tuple[str, str], Cause], cause: Cause) -> None:
    """Take in a cause; one that several stages or ways lead to is one cause with the consequences of all."""
    place = "" if cause.difference.part in SHARED else cause.stage
    key = (place, cause.difference.identity)
    if key in found:
        cause = replace(found[key], consequences=_joined(found[key].consequences, cause.consequences))
    found[key] = cause


def _joined(first: tuple[str, ...], second: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*first, *second)))


def _rank(cause: Cause) -> int:
    return list(_NOUNS).index(cause.difference.part)


def compare(old: Recipe, new: Recipe) -> Iterator[Difference]:
    """Every difference between two recipes of one stage."""
    yield from _differences("inputs", _named(old.inputs), _named(new.inputs))
    yield from _differences("config", old.config, new.config)
    # Which tasks they are follows from configuration and inputs.
    for task in sorted(old.tasks.keys() & new.tasks.keys()):
        if old.tasks[task] == new.tasks[task]:
            continue
        was, will_be = (_by_name(recipe.tasks[task]) for recipe in (old, new))
        yield from _differences("tasks", was, will_be, f"{task}: ")
    if old.code != new.code:
        changed = list(_differences("code", old.modules, new.modules))
        # Without module versions there is only the version of the whole.
        yield from changed or [Difference("code", new.stage, "changed", old.code, new.code)]
    yield from _differences("files", old.files, new.files)
    yield from _differences("libraries", old.libraries, new.libraries)


_NOUNS: Mapping[Part, str] = {
    "config": "config key",
    "files": "file",
    "inputs": "input",
    "tasks": "task",
    "libraries": "library",
    "code": "code of",
}
"""In the order in which they are told."""


def _differences(part: Part, old: Mapping[str, Any], new: Mapping[str, Any], prefix: str = "") -> Iterator[Difference]:
    """Every difference between nested mappings by dotted key; what stands in one alone is one, sections too."""
    for key in sorted(old.keys() | new.keys()):
        name = f"{prefix}{key}"
        if key not in old:
            yield Difference(part, name, "added", None, new[key])
        elif key not in new:
            yield Difference(part, name, "removed", old[key], None)
        elif isinstance(old[key], Mapping) and isinstance(new[key], Mapping):
            yield from _differences(part, old[key], new[key], f"{name}.")
        elif old[key] != new[key]:
            yield Difference(part, name, "changed", old[key], new[key])


def _named(inputs: Mapping[str, Sequence[ArtifactRef]]) -> dict[str, list[str]]:
    return {role: [str(ref) for ref in refs] for role, refs in inputs.items()}


def _by_name(value: Any) -> Any:
    """The same with lists of things as mappings: by their names or labels, or by their places."""
    if isinstance(value, Mapping):
        return {key: _by_name(item) for key, item in value.items()}
    if not isinstance(value, list) or not any(isinstance(item, Mapping | list) for item in value):
        return value
    named = [item.get("name", item.get("label")) if isinstance(item, Mapping) else None for item in value]
    names = [str(place if name is None else name) for place, name in enumerate(named)]
    order = {"order": names} if any(named) else {}
    return {**order, **{name: _by_name(item) for name, item in zip(names, value, strict=True)}}


def _shown(value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, list) and all(isinstance(item, str) for item in value):
        return ", ".join(value)
    return json.dumps(value)
