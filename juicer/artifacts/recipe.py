"""The recipe of an artifact: everything its content depends on, and therefore its identity."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from juicer.artifacts.ref import ID_LENGTH, KINDS, ArtifactRef
from juicer.config import canonical_json
from juicer.errors import did_you_mean


@dataclass(frozen=True)
class Recipe:
    """What a stage run is made of; equal recipes make equal artifacts.

    Attributes:
        stage: Name of the stage.
        kind: Kind of artifact it makes.
        inputs: Artifacts it reads, by role; the order within a role counts, a role without any does not.
        config: Its configuration as JSON values.
        code: Version of its code, see :func:`juicer.artifacts.code_version.code_version`.
        files: SHA-256 of the files it reads from outside the store, by label.
        libraries: Versions of the libraries that shape its output.
        tasks: Content of every task that it concerns, by name, as far as it counts for the stage; see
            :func:`juicer.tasks.content.task_content`.
        modules: Version of every module behind ``code``. Not part of the identity; kept so that a miss can be
            explained by the names of the modules that changed.
        plugins: What its configuration chose at junctions and from outside, by module. Not part of the identity, as
            their source is in ``code``; kept for the stages that work with what this one made.

    Raises:
        ValueError: If the kind is unknown, or the config holds something that JSON cannot say.
    """

    stage: str
    kind: str
    inputs: Mapping[str, tuple[ArtifactRef, ...]] = field(default_factory=dict)
    config: Mapping[str, Any] = field(default_factory=dict)
    code: str = ""
    files: Mapping[str, str] = field(default_factory=dict)
    libraries: Mapping[str, str] = field(default_factory=dict)
    modules: Mapping[str, str] = field(default_factory=dict, compare=False)
    plugins: tuple[str, ...] = field(default=(), compare=False)
    tasks: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Bring equal content to equal form, so that a recipe equals its own JSON read back."""
        if self.kind not in KINDS:
            raise ValueError(f"'{self.kind}' is not a kind of artifact{did_you_mean(self.kind, KINDS)}")
        object.__setattr__(self, "config", json.loads(canonical_json(self.config)))
        object.__setattr__(self, "tasks", json.loads(canonical_json(self.tasks)))
        object.__setattr__(self, "plugins", tuple(self.plugins))
        object.__setattr__(self, "inputs", {role: tuple(refs) for role, refs in self.inputs.items() if refs})

    @cached_property
    def id(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of the canonical JSON."""
        identity = {key: value for key, value in self.to_json().items() if key not in ("modules", "plugins")}
        return hashlib.sha256(canonical_json(identity).encode()).hexdigest()[:ID_LENGTH]

    @property
    def ref(self) -> ArtifactRef:
        """The artifact this recipe makes."""
        return ArtifactRef(self.kind, self.id)

    @property
    def parents(self) -> tuple[ArtifactRef, ...]:
        """Every input once, in order of first use."""
        return tuple(dict.fromkeys(ref for refs in self.inputs.values() for ref in refs))

    def to_json(self) -> dict[str, Any]:
        """The recipe as JSON values."""
        # Left out where there are none: artifacts of the time before them stay what they are.
        more: dict[str, Any] = {"tasks": dict(self.tasks)} if self.tasks else {}
        more |= {"plugins": list(self.plugins)} if self.plugins else {}
        return {
            **more,
            "stage": self.stage,
            "kind": self.kind,
            "inputs": {role: [str(ref) for ref in refs] for role, refs in self.inputs.items()},
            "config": dict(self.config),
            "code": self.code,
            "files": dict(self.files),
            "libraries": dict(self.libraries),
            "modules": dict(self.modules),
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Recipe:
        """Read back what :meth:`to_json` gave."""
        inputs = {role: tuple(map(ArtifactRef.parse, refs)) for role, refs in content["inputs"].items()}
        return cls(**{**content, "inputs": inputs})
