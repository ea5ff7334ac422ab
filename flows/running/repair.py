"""Damaged artifacts are made whole: from what is at hand if that is possible, else from what they were made from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from juicer.artifacts.explain import compare
from juicer.artifacts.findings import Nature
from juicer.artifacts.manifest import Manifest
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.config import parse_config
from juicer.errors import ArtifactError, ArtifactNotFound, ConfigError, DamagedArtifact, StrayFile, UnreadableArtifact
from juicer.text import printable
from stages.runtime.catalog import find_stage
from stages.runtime.session import Session
from stages.runtime.stage import Origins, StageCall


@dataclass(frozen=True)
class Repaired:
    """An artifact that is whole again.

    Attributes:
        ref: Which.
        recomputed: Whether it had to be made again; otherwise all of it was still at hand.
        aside: Where that is kept which was in its place and not as it was written, if anything was.
    """

    ref: ArtifactRef
    recomputed: bool
    aside: str | None


def repair(session: Session, ref: ArtifactRef, folder: Path | None = None) -> Iterator[Repaired]:
    """Make an artifact whole if it is damaged; before that, whatever it was made from and is needed for it.

    Args:
        session: Where the stages run.
        ref: The artifact.
        folder: Where the files from outside the store are that it was made from, if any.

    Raises:
        ArtifactNotFound: If there is no such artifact, or one that it was made from is gone.
        StrayFile: If all that is wrong is a file that does not belong to it.
        UnreadableArtifact: If the disk does not let it be read; nothing is changed then.
        ArtifactError: If it cannot be made as it was.
    """
    # What waits for the repair of the one behind it; a chain may be longer than Python's stack.
    waiting = [ref]
    while waiting:
        current = waiting[-1]
        before = session.store.asides(current)
        if _is_whole(session, current):
            waiting.pop()
        elif session.store.mend(current) and _is_whole(session, current):
            yield Repaired(waiting.pop(), False, _newest(session, current, before))
        else:
            manifest = _manifest(session, current, is_asked_for=current == ref)
            read = _read_by(session, manifest.recipe)
            parent = next((each for each in read if not _is_usable(session, each, current)), None)
            if parent is not None:
                waiting.append(parent)
                continue
            call = rebuild_call(manifest.recipe, folder, session)
            forced = frozenset({manifest.recipe.stage})
            replace(session, forced=forced, fresh=set(), label="").perform(call)
            if not _is_whole(session, current):
                raise ArtifactError(f"{current} was made again and is damaged again; check the disk it lies on")
            yield Repaired(waiting.pop(), True, _newest(session, current, before))


def rebuild_call(recipe: Recipe, folder: Path | None, origins: Origins) -> StageCall:
    """The stage call that made an artifact.

    Args:
        recipe: What it was made of.
        folder: Where the files from outside the store are.
        origins: Who knows what the inputs are made of.

    Raises:
        ArtifactError: If the stage would make another artifact today, because code, libraries or files changed.
    """
    stage, origin = find_stage(recipe.stage), f"the manifest of {recipe.ref}"
    failure = f"{recipe.ref} cannot be made again as it was"
    successor = "run its flow again to make its successor"
    try:
        arguments: dict[str, Any] = {"config": parse_config(recipe.config, stage.config_model, origin=origin)}
        for role, refs in recipe.inputs.items():
            arguments[role] = refs if stage.takes_many(role) else refs[0]
        for label in recipe.files:
            role, _, name = label.partition("/")
            path = _file(name, folder)
            arguments[role] = (*arguments.get(role, ()), path) if stage.takes_many(role) else path
    except ConfigError as error:
        raise ArtifactError(f"{failure}: {error}; {successor}") from None
    except KeyError as error:
        raise ArtifactError(f"{failure}: stage '{recipe.stage}' takes no {printable(error)}; {successor}") from None
    call = stage.prepare(origins, **arguments)
    if call.recipe.id != recipe.id:
        changes = printable("; ".join(difference.sentence for difference in compare(recipe, call.recipe)), 1000)
        raise ArtifactError(f"{failure}: {changes}; {successor}")
    return call


def _file(name: str, folder: Path | None) -> Path:
    shown = printable(name)
    if name != Path(name).name:
        raise ArtifactError(f"it was made from the file '{shown}', which is no name of a file")
    if folder is None:
        raise ArtifactError(f"it was made from the file '{shown}'; say with --files where that is")
    if not folder.is_dir():
        raise ArtifactError(f"there is no folder '{printable(folder)}'; say with --files where the file '{shown}' is")
    return folder / name


def _is_whole(session: Session, ref: ArtifactRef) -> bool:
    """Whether an artifact needs no repair.

    Raises:
        UnreadableArtifact: If that cannot be told.
        StrayFile: If it needs none but for a file that must go.
    """
    findings = session.store.verify(ref)
    if unread := [str(finding) for finding in findings if finding.nature is Nature.UNREADABLE]:
        session.store.open(ref)  # raises, and says what to do
        raise UnreadableArtifact(f"artifact {ref} may be whole, but {unread[0]}")
    if any(finding.nature is Nature.DAMAGE for finding in findings):
        return False
    if stray := [str(finding) for finding in findings if finding.nature is Nature.STRAY]:
        raise StrayFile(
            f"nothing in {ref} needs to be recomputed, but {', '.join(stray[:3])}; "
            f"remove that from '{session.store.address(ref)}'"
        )
    return True


def _manifest(session: Session, ref: ArtifactRef, *, is_asked_for: bool) -> Manifest:
    """What a damaged artifact was made from; if its manifest does not tell, the artifact is put aside."""
    try:
        return session.store.manifest(ref)
    except DamagedArtifact as error:
        if not is_asked_for:
            raise ArtifactError(f"a repair needs {ref}, but {error}") from None
        aside = session.store.set_aside(ref)
        raise ArtifactError(
            f"the manifest of {ref} is unusable, and with it what it was made from; nothing was deleted: all of it is "
            f"now in '{aside}'; run the flow that made it again, and delete that folder when you need it no more"
        ) from None


def _read_by(session: Session, recipe: Recipe) -> Iterator[ArtifactRef]:
    """What a stage reads: its inputs, and behind a dataset, which is only an index, the episodes that it names."""
    for ref in recipe.parents:
        yield ref
        if ref.kind == "dataset":
            yield from session.store.manifest(ref).recipe.parents


def _is_usable(session: Session, parent: ArtifactRef, child: ArtifactRef) -> bool:
    if not session.store.exists(parent):
        raise ArtifactNotFound(f"{child} was made from {parent}, which is gone; run the flow that made it again")
    return _is_whole(session, parent)


def _newest(session: Session, ref: ArtifactRef, before: object) -> str | None:
    after = session.store.asides(ref)
    return after[-1] if after and after != before else None
