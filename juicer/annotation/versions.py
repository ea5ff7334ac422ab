"""What people said about critical states, version by version: a file that only grows.

Each line is JSON and says one thing that one person said about one critical state of one episode, or takes back what
was said before. A line is never changed, so nobody can overwrite what somebody else has said. Whoever saves names the
version of that critical state that was seen; if there is a newer one, nothing is saved and both are shown.

A line is on the disk before its saving is confirmed. What a kill leaves of a line is not a line: it is passed over, and
the next one takes its place.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from io import BufferedRandom
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, ValidationError, model_validator
from pydantic_core import from_json

from juicer.artifacts.integrity import sync
from juicer.config import StrictConfig
from juicer.errors import AnnotationConflict, AnnotationsNotSaved, InvalidLabels
from juicer.problems import first_problem
from juicer.reading import UnsuitableFile, read_bounded
from juicer.text import printable

ENDING = ".versions.jsonl"

PAGE = "page"
"""How the tool of what is said on the page ends, after juicer's version and a comma."""

MOST_BYTES = 2**24
"""Largest file: room for some fifty thousand versions."""

_MOST_STEPS = 10**9


def _can_be_shown(text: str) -> str:
    if printable(text) != text or text != text.strip():
        raise ValueError("must be plain text, without control characters or blanks around it")
    return text


PlainText = Annotated[str, AfterValidator(_can_be_shown)]
Author = Annotated[PlainText, Field(min_length=1, max_length=100)]
Step = Annotated[int, Field(ge=0, lt=_MOST_STEPS)]
Key = tuple[str, int]
"""Episode and critical state."""


class Entry(StrictConfig):
    """One thing that somebody said.

    Attributes:
        episode: Id of the episode.
        critical_state: Which one of its task, from 0.
        step: Step of the recording just before the critical interaction; none in an entry that takes another back.
        after: Newest version of this critical state that its author had seen; 0 if none.
        author: Who said it.
        tool: With what it was said.
        time: When, in ISO 8601.
        proposal: Step of the recording that was proposed, if any was.
        confidence: Confidence of that proposal.
        keys: Keys pressed and buttons clicked for it.
        seconds: Time spent on it.
        settles: Whether it decides between those who disagreed before.
        undoes: Version that it takes back.
    """

    episode: str = Field(pattern=r"^[0-9a-f]{16}$")
    critical_state: int = Field(ge=0, lt=1000)
    step: Step | None
    after: int = Field(ge=0)
    author: Author
    tool: PlainText = Field(default="", max_length=100)
    time: PlainText = Field(default="", max_length=40)
    proposal: Step | None = None
    confidence: float | None = Field(default=None, ge=0, le=1)
    keys: int = Field(default=0, ge=0, le=100_000)
    seconds: float = Field(default=0, ge=0, le=100_000)
    settles: bool = False
    undoes: int | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _marks_or_takes_back(self) -> Entry:
        if (self.step is None) != (self.undoes is not None):
            raise ValueError("must have either a step or a version that it undoes")
        return self

    @property
    def key(self) -> Key:
        """Episode and critical state that it is about."""
        return self.episode, self.critical_state

    @property
    def is_from_page(self) -> bool:
        """Whether it was said on the page, of whatever version of juicer, so that what it took is known."""
        return self.tool.endswith(f", {PAGE}")


class Version(Entry):
    """An entry with its number in the file, from 1."""

    version: int = Field(gt=0)


def versions_path(folder: Path, task: str) -> Path:
    """Where what people said about a task's episodes is.

    Args:
        folder: The data folder.
        task: Name of the task.
    """
    return folder / "labels" / f"{task}{ENDING}"


def is_versions(path: Path) -> bool:
    """Whether a labels file holds versions, by its name."""
    return path.name.endswith(ENDING)


def read_versions(path: Path) -> list[Version]:
    """All versions, the oldest first; none if there is no file.

    Raises:
        InvalidLabels: If the file cannot be read, or a line is none that :func:`save` writes.
    """
    try:
        content = read_bounded(path, MOST_BYTES)
    except FileNotFoundError:
        return []
    except OSError as error:
        raise InvalidLabels(f"annotations '{printable(path)}' cannot be read: {error.strerror or error}") from None
    return _parse(content, path)[0]


def save(path: Path, entries: Sequence[Entry]) -> list[Version]:
    """Append entries, all of them or none, and force them onto the disk.

    Raises:
        AnnotationConflict: If there is a newer version of a critical state than the entry's author had seen.
        AnnotationsNotSaved: If the disk refuses.
        InvalidLabels: If the file cannot be understood; it stays as it is.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with _locked(path) as file:
            content = file.read(MOST_BYTES + 1)
            if len(content) > MOST_BYTES:
                raise UnsuitableFile(path, f"it is larger than {MOST_BYTES:,} bytes")
            versions, whole = _parse(content, path)
            added = list(_numbered(versions, entries, path))
            lines = b"".join(each.model_dump_json(exclude_defaults=True).encode() + b"\n" for each in added)
            _append(file, whole, lines if content[:whole].endswith(b"\n") or not whole else b"\n" + lines)
            sync(path.parent)
    except OSError as error:
        raise AnnotationsNotSaved(
            f"annotations '{printable(path)}' cannot be saved: {error.strerror or error}; nothing of this was saved"
        ) from None
    return added


def _numbered(versions: Sequence[Version], entries: Iterable[Entry], path: Path) -> Iterator[Version]:
    newest = {version.key: version for version in versions}
    undone = {version.undoes for version in versions}
    standing = {version.version: version for version in versions if version.version not in undone}
    for number, entry in enumerate(entries, start=len(versions) + 1):
        last = newest.get(entry.key)
        if (last.version if last else 0) != entry.after:
            raise AnnotationConflict(
                f"critical state {entry.critical_state} of episode {entry.episode} was annotated meanwhile"
                + (f" by {last.author}" if last else "")
                + "; look at both and decide"
            )
        if entry.undoes is not None:
            _check_undoes(entry, standing.get(entry.undoes), printable(path.name))
        yield Version(**entry.model_dump(), version=number)


def _check_undoes(entry: Entry, undone: Version | None, where: str) -> None:
    if undone is None or undone.key != entry.key or undone.author != entry.author or undone.undoes is not None:
        raise InvalidLabels(f"{where}: version {entry.undoes} is not a mark of {entry.author} that could be taken back")


def _append(file: BufferedRandom, whole: int, lines: bytes) -> None:
    try:
        file.truncate(whole)
        file.seek(whole)
        file.write(lines)
        file.flush()
        os.fsync(file.fileno())
    except OSError:
        # What was written of them must not be taken for a version.
        with suppress(OSError):
            os.ftruncate(file.fileno(), whole)
        raise


@contextmanager
def _locked(path: Path) -> Iterator[BufferedRandom]:
    """The file, open for this process and thread alone; an editor may have put another in its place meanwhile."""
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
        file = os.fdopen(descriptor, "r+b")
        fcntl.flock(file, fcntl.LOCK_EX)
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(descriptor), path.stat()):
                break
        file.close()
    try:
        yield file
    finally:
        with suppress(OSError):
            file.close()


def _parse(content: bytes, path: Path) -> tuple[list[Version], int]:
    """Versions, and the bytes that they take: what follows was being written when its writer was killed."""
    versions: list[Version] = []
    whole = 0
    for number, line in enumerate(content.splitlines(keepends=True), start=1):
        where = f"{printable(path.name)}, line {number}"
        try:
            value = from_json(line, allow_inf_nan=False)
        except ValueError:
            if not line.endswith(b"\n"):
                break
            raise InvalidLabels(f"{where}: it is not JSON; {_remedy(path)}") from None
        versions.append(_version(value, number, where, path))
        whole += len(line)
    return versions, whole


def _version(value: Any, number: int, where: str, path: Path) -> Version:
    try:
        version = Version.model_validate(value)
    except ValidationError as error:
        problem = first_problem(error, value, Version).sentence
        raise InvalidLabels(f"{where}: {problem}; {_remedy(path)}") from None
    if version.version != number:
        raise InvalidLabels(f"{where}: version {version.version} stands in place of {number}; {_remedy(path)}")
    return version


def _remedy(path: Path) -> str:
    return f"put back the lines of '{printable(path)}' that were changed by hand, or move the file away"
