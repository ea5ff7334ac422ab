"""The manifest of an artifact: what it is, what made it, and the hash of every file in it."""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from juicer import __version__
from juicer.artifacts.commit import source_commit
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.config import canonical_json

SCHEMA_VERSION = 1
MANIFEST_NAME = "manifest.json"


@dataclass(frozen=True)
class FileEntry:
    """One file of an artifact: POSIX path within it, size in bytes, SHA-256 in hexadecimal digits.

    Raises:
        ValueError: If the path leads out of the artifact, as a forged manifest might.
    """

    path: str
    bytes: int
    sha256: str

    def __post_init__(self) -> None:
        """Check the path."""
        if self.path.startswith("/") or ".." in self.path.split("/"):
            raise ValueError(f"'{self.path}' leads out of the artifact")


@dataclass(frozen=True)
class Manifest:
    """Description of a finished artifact.

    Attributes:
        recipe: What it was made of.
        files: Every file but the manifest itself, sorted by path.
        summary: JSON facts for people: counts, rates.
        host: Where it was made: machine, platform, Python, number of CPUs, version and commit of juicer.
        started: Local time with offset, ISO 8601.
        finished: The same.
        seconds: Wall time between the two.
        schema_version: Version of this record.
    """

    recipe: Recipe
    files: tuple[FileEntry, ...]
    summary: Mapping[str, Any]
    host: Mapping[str, Any]
    started: str
    finished: str
    seconds: float
    schema_version: int = SCHEMA_VERSION

    @property
    def ref(self) -> ArtifactRef:
        """The artifact described."""
        return self.recipe.ref

    @property
    def content(self) -> str:
        """16 hexadecimal digits that differ between artifacts with different files."""
        lines = "\n".join(f"{entry.sha256} {entry.path}" for entry in self.files)
        return hashlib.sha256(lines.encode()).hexdigest()[:16]

    def to_text(self) -> str:
        """JSON text of the manifest, sealed by its own SHA-256."""
        body = {
            "schema_version": self.schema_version,
            "recipe": self.recipe.to_json(),
            "files": [asdict(entry) for entry in self.files],
            "summary": dict(self.summary),
            "host": dict(self.host),
            "started": self.started,
            "finished": self.finished,
            "seconds": self.seconds,
        }
        return _seal(body)

    @classmethod
    def from_text(cls, text: str) -> Manifest:
        """Read a manifest.

        Raises:
            ValueError: If the text is not exactly what :meth:`to_text` wrote, or has another schema version.
        """
        try:
            body = json.loads(text)
            version, _ = body["schema_version"], body.pop("sha256")
        except (KeyError, TypeError, json.JSONDecodeError):
            raise ValueError("it is not a manifest") from None
        if version != SCHEMA_VERSION:
            raise ValueError(f"it has schema version {version}, this juicer reads {SCHEMA_VERSION}")
        if _seal(body) != text:
            raise ValueError("its text does not match its checksum")
        return cls(
            recipe=Recipe.from_json(body.pop("recipe")),
            files=tuple(FileEntry(**entry) for entry in body.pop("files")),
            **body,
        )


def describe_host() -> dict[str, Any]:
    """Facts about this machine, interpreter and code that help to judge timings and results."""
    return {
        "name": platform.node(),
        "platform": platform.platform(),
        "python": platform.python_version(),
        "cpus": os.cpu_count(),
        "juicer": __version__,
        "commit": source_commit(),
    }


def plain(value: Any) -> Any:
    """``value`` as strict JSON: NumPy scalars become numbers, NaN and infinities ``None``."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _seal(body: Mapping[str, Any]) -> str:
    """The one text of a manifest: it holds its own SHA-256, so that no byte of it can change unnoticed."""
    digest = hashlib.sha256(canonical_json(body).encode()).hexdigest()
    return json.dumps({**body, "sha256": digest}, indent=1, sort_keys=True, allow_nan=False) + "\n"
