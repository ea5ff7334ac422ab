"""The manifest of an artifact: what it is, what made it, and the hash of every file in it."""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import PurePosixPath
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from juicer import __version__
from juicer.artifacts.commit import source_commit
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ID_LENGTH, KINDS, ArtifactRef
from juicer.config import canonical_json
from juicer.text import printable

SCHEMA_VERSION = 1
MANIFEST_NAME = "manifest.json"
FINDING = "finding"
"""Key of a summary: in a sentence, why an artifact holds nothing, or less than it seems to."""
OBSERVES, STATE = "observes", "state"
"""Key of the summary of a checkpoint or an evaluation: what the policy sees, and what it was taught with beside; and
its value where that is the poses of all parts."""
SHIFT = "shift"
"""Key of the summary of an evaluation under a shift: how it was done, as the end of a sentence."""
CPU_SECONDS = "cpu_seconds"
"""Key of what a manifest says of its host: CPU time of making the artifact, by all processes that were busy with it."""
HEADLINE, LABEL = "headline", "label"
"""Keys of a summary: what is worth saying of an artifact on one line; what it is, in two or three words."""

MOST_BYTES = 2**24
"""Of a manifest: a hundred thousand files."""
DEEPEST = 64
"""Levels within a manifest; its own are five, a configuration's about ten."""
MOST_COUNTS = 3
"""That stand in for a headline."""
LONGEST_FACT = 2000
"""Letters of one fact in a summary."""


class AnotherVersionError(ValueError):
    """A manifest was written by a later juicer."""


@dataclass(frozen=True)
class FileEntry:
    """One file of an artifact: POSIX path within it, size in bytes, SHA-256 in hexadecimal digits.

    Raises:
        ValueError: If the path leads out of the artifact, as that of a forged manifest might, or is none.
    """

    path: str
    bytes: int
    sha256: str

    def __post_init__(self) -> None:
        """Check the path."""
        if self.path.startswith("/") or ".." in self.path.split("/"):
            raise ValueError(f"'{printable(self.path)}' leads out of the artifact")
        if "\0" in self.path or self.path in ("", ".") or str(PurePosixPath(self.path)) != self.path:
            raise ValueError(f"'{printable(self.path)}' is no path of a file")


@dataclass(frozen=True)
class Manifest:
    """Description of a finished artifact.

    Attributes:
        recipe: What it was made of.
        files: Every file but the manifest itself, sorted by path.
        summary: JSON facts for people: counts, rates.
        host: Where it was made: machine, platform, Python, number of CPUs, version and commit of juicer, CPU time.
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
    def finding(self) -> str:
        """Why the artifact holds nothing, or less than it seems to; empty if there is nothing of the kind to say."""
        return str(self.summary.get(FINDING, ""))

    @property
    def cpu_seconds(self) -> float | None:
        """CPU time of making it, by all processes that were busy with it; None if it was not measured."""
        found = self.host.get(CPU_SECONDS)
        return float(found) if isinstance(found, int | float) else None

    @property
    def observes(self) -> str:
        """What the policy sees, and what it was taught with beside; empty if the artifact does not say."""
        return str(self.summary.get(OBSERVES, ""))

    @property
    def headline(self) -> str:
        """What is worth saying of the artifact on one line."""
        return headline_of(self.summary)

    @property
    def label(self) -> str:
        """What the artifact is, in a few words."""
        return str(self.summary.get(LABEL, self.recipe.stage))

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
            AnotherVersionError: If a later juicer wrote it.
            ValueError: If the text is not exactly what :meth:`to_text` wrote.
        """
        manifest = cls._read(text)
        if manifest.to_text() != text:
            raise ValueError("its text does not match its checksum")
        return manifest

    @classmethod
    def salvage(cls, text: str) -> Manifest | None:
        """What a manifest said whose content is whole by its own checksum, though not its text.

        An editor may have changed the line ends, or something may have been written behind it.
        """
        try:
            return cls._read(text.lstrip("\ufeff \t\r\n"))
        except ValueError:
            return None

    @classmethod
    def _read(cls, text: str) -> Manifest:
        """The manifest that a text begins with."""
        body = _parse(text)
        version, stated = body.get("schema_version"), body.pop("sha256", None)
        if isinstance(version, int) and version > SCHEMA_VERSION:
            altered = _digest({**body, "schema_version": SCHEMA_VERSION}) == stated
            error_type = ValueError if altered else AnotherVersionError
            raise error_type(f"it has schema version {version}, this juicer reads {SCHEMA_VERSION}")
        if stated is None or version != SCHEMA_VERSION:
            raise ValueError("it is not a manifest")
        if _digest(body) != stated:
            raise ValueError("its text does not match its checksum")
        try:
            _Body.model_validate(body)
        except ValidationError as error:
            where = ".".join(map(str, error.errors()[0]["loc"]))
            raise ValueError(f"its entry '{printable(where)}' is not what juicer writes") from None
        files = tuple(FileEntry(**entry) for entry in body.pop("files"))
        return cls(recipe=Recipe.from_json(body.pop("recipe")), files=files, **body)


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _FileBody(_Record):
    path: str
    bytes: Annotated[int, Field(ge=0)]
    sha256: str


_Kind = Annotated[str, Field(pattern=f"^({'|'.join(KINDS)})$")]
_Ref = Annotated[str, Field(pattern=f"^({'|'.join(KINDS)})/[0-9a-f]{{{ID_LENGTH}}}$")]


class _RecipeBody(_Record):
    stage: str
    kind: _Kind
    inputs: dict[str, list[_Ref]]
    config: dict[str, Any]
    code: str
    files: dict[str, str]
    libraries: dict[str, str]
    modules: dict[str, str] = {}
    plugins: list[str] = []
    tasks: dict[str, dict[str, Any]] = {}


def _with_offset(text: str) -> str:
    if datetime.fromisoformat(text).tzinfo is None:
        raise ValueError("no offset")
    return text


class _Body(_Record):
    """Types of a manifest's content: a shared store may hold what somebody else composed and sealed."""

    schema_version: int
    recipe: _RecipeBody
    files: list[_FileBody]
    summary: dict[str, Any]
    host: dict[str, Any]
    started: Annotated[str, AfterValidator(_with_offset)]
    finished: Annotated[str, AfterValidator(_with_offset)]
    seconds: FiniteFloat


def headline_of(summary: Mapping[str, Any]) -> str:
    """What is worth saying of an artifact on one line; of one that says nothing of itself, the first things it counts.

    Artifacts of earlier versions have no headline.
    """
    counts = [f"{name.replace('_', ' ')} {value}" for name, value in summary.items() if type(value) is int]
    return str(summary.get(HEADLINE) or summary.get(FINDING) or ", ".join(counts[:MOST_COUNTS]))


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
    """``value`` as strict JSON: numbers of NumPy become plain ones, NaN and infinities ``None``, texts printable."""
    if isinstance(value, Mapping):
        return {printable(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return printable(value, LONGEST_FACT) if isinstance(value, str) else value


def _seal(body: Mapping[str, Any]) -> str:
    """The one text of a manifest: it holds its own SHA-256, so that no byte of it can change unnoticed."""
    return json.dumps({**body, "sha256": _digest(body)}, indent=1, sort_keys=True, allow_nan=False) + "\n"


def _digest(body: Mapping[str, Any]) -> str:
    return hashlib.sha256(canonical_json(body).encode()).hexdigest()


def _parse(text: str) -> dict[str, Any]:
    """The JSON object that a text begins with.

    Raises:
        ValueError: If there is none, or one that no manifest is.
    """
    try:
        body, _ = json.JSONDecoder().raw_decode(text)
        # Numbers that JSON does not know, or that are infinite.
        json.dumps(body, allow_nan=False)
        levels: list[Any] = [body]
        for _ in range(DEEPEST):
            levels = [child for value in levels for child in _children(value)]
    except (ValueError, RecursionError):
        raise ValueError("it is not a manifest") from None
    if not isinstance(body, dict) or levels:
        raise ValueError("it is not a manifest")
    return body


def _children(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return list(value.values())
    return value if isinstance(value, list) else []
