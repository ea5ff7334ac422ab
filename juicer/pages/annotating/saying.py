"""What an annotator says on the page becomes versions on the disk."""

from __future__ import annotations

from datetime import datetime

from pydantic import Field

from juicer import __version__
from juicer.annotation.versions import PAGE, Author, Entry, Version, read_versions, save
from juicer.config import StrictConfig
from juicer.errors import NothingLeft
from juicer.pages.annotating.desk import Desk
from juicer.pages.annotating.proposals import Proposals

TOOL = f"juicer {__version__}, {PAGE}"
MOST_MARKS = 2000
PATIENCE_SECONDS = 20.0
"""How long a mark waits for proposals: they are looked for again by a server that was started meanwhile."""


class Judged(StrictConfig):
    """A critical state that somebody has judged; all as in :class:`Entry`."""

    episode: str = Field(max_length=16)
    critical_state: int = Field(ge=0, lt=1000)
    after: int = Field(ge=0)
    keys: int = Field(default=0, ge=0, le=100_000)
    seconds: float = Field(default=0, ge=0, le=100_000)


class Mark(Judged):
    """A critical state that somebody marks at a step of the episode."""

    step: int = Field(ge=0)
    settles: bool = False


class Marks(StrictConfig):
    """Marks that are saved together, all or none."""

    author: Author
    marks: list[Mark] = Field(min_length=1, max_length=MOST_MARKS)


class TakenBack(Judged):
    """A version that its author takes back."""

    undoes: int = Field(gt=0)


class Undo(StrictConfig):
    """Versions that are taken back together, all or none."""

    author: Author
    marks: list[TakenBack] = Field(min_length=1, max_length=MOST_MARKS)


def say(desk: Desk, said: Marks) -> list[Version]:
    """Save marks.

    Raises:
        AnnotationConflict: If there is a newer version of one than its author had seen.
        AnnotationsNotSaved: If the disk refuses.
        InvalidLabels: If the file of versions cannot be understood.
        ArtifactError: If there is no such demonstration.
        NothingLeft: If it has no such step or critical state, or it is not known yet what is proposed there.
    """
    proposals = desk.proposals(PATIENCE_SECONDS)
    if proposals is None:
        raise NothingLeft("the demonstrations are still being searched for critical states; try again in a minute")
    return save(desk.path, [_entry(desk, said.author, mark, proposals) for mark in said.marks])


def take_back(desk: Desk, undo: Undo) -> list[Version]:
    """Save that somebody takes back what they said; of what is taken back already, nothing more is saved.

    Raises:
        AnnotationConflict: If there is a newer version of one than its author had seen.
        AnnotationsNotSaved: If the disk refuses.
        InvalidLabels: If one is not a mark of this author, or the file of versions cannot be understood.
        ArtifactError: If there is no such demonstration.
        NothingLeft: If the task has no such critical state.
    """
    for mark in undo.marks:
        desk.check_episode(mark.episode)
        desk.check_critical_state(mark.critical_state)
    # The answer to an earlier attempt may have been lost.
    done = {version.undoes for version in read_versions(desk.path)}
    return save(
        desk.path,
        [
            Entry(
                **mark.model_dump(exclude={"seconds"}),
                step=None,
                seconds=round(mark.seconds, 2),
                author=undo.author,
                tool=TOOL,
                time=_now(),
            )
            for mark in undo.marks
            if mark.undoes not in done
        ],
    )


def _entry(desk: Desk, author: str, mark: Mark, proposals: Proposals) -> Entry:
    desk.check_critical_state(mark.critical_state)
    proposal = proposals.get((mark.episode, mark.critical_state))
    return Entry(
        **mark.model_dump(exclude={"step", "seconds"}),
        step=desk.recorded_step(mark.episode, mark.step),
        seconds=round(mark.seconds, 2),
        author=author,
        tool=TOOL,
        time=_now(),
        proposal=desk.recorded_step(mark.episode, proposal.step) if proposal else None,
        confidence=proposal.confidence if proposal else None,
    )


def _now() -> str:
    return datetime.now().astimezone().isoformat(timespec="seconds")
