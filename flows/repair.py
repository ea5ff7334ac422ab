"""Damaged artifacts are computed again from what they were made from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from juicer.artifacts.explain import compare
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import parse_config
from juicer.errors import ArtifactError, ArtifactNotFound, DamagedArtifact
from stages.catalog import find_stage
from stages.session import Session
from stages.stage import StageCall


def repair(session: Session, ref: ArtifactRef, folder: Path | None = None) -> Iterator[ArtifactRef]:
    """Recompute an artifact if it is damaged, after whatever it was made from; yields what was recomputed.

    Args:
        session: Where the stages run.
        ref: The artifact.
        folder: Where the files from outside the store are that it was made from, if any.

    Raises:
        ArtifactNotFound: If there is no such artifact, or one that it was made from is gone.
        UnreadableArtifact: If the disk does not let its manifest be read; nothing is changed then.
        ArtifactError: If it cannot be made as it was.
    """
    store = session.store
    try:
        recipe = store.manifest(ref).recipe
    except DamagedArtifact:
        store.discard(ref)
        raise ArtifactError(
            f"the manifest of {ref} is unreadable, and with it what it was made from, so it was discarded; "
            "run the flow that made it again"
        ) from None
    for parent in recipe.parents:
        if _exists(store, parent):
            yield from repair(session, parent, folder)
        else:
            raise ArtifactNotFound(f"{ref} was made from {parent}, which is gone; run the flow that made it again")
    if store.verify(ref):
        call = rebuild_call(recipe, folder)
        session.perform(call, replace(session, forced=frozenset({recipe.stage}), fresh=set(), label=""))
        yield ref


def rebuild_call(recipe: Recipe, folder: Path | None) -> StageCall:
    """The stage call that made an artifact.

    Raises:
        ArtifactError: If the stage would make another artifact today, because code, libraries or files changed.
    """
    stage = find_stage(recipe.stage)
    arguments: dict[str, Any] = {"config": parse_config(recipe.config, stage.config_model, origin="its manifest")}
    for role, refs in recipe.inputs.items():
        arguments[role] = refs if stage.takes_many(role) else refs[0]
    for label in recipe.files:
        role, _, name = label.partition("/")
        if folder is None:
            raise ArtifactError(f"it was made from the file '{name}'; say with --files where that is")
        path = folder / name
        arguments[role] = (*arguments.get(role, ()), path) if stage.takes_many(role) else path
    call = stage.prepare(**arguments)
    if call.recipe.id != recipe.id:
        changes = "; ".join(difference.sentence for difference in compare(recipe, call.recipe))
        raise ArtifactError(
            f"{recipe.ref} cannot be made again as it was: {changes}; run its flow again to make its successor"
        )
    return call


def _exists(store: ArtifactStore, ref: ArtifactRef) -> bool:
    return ref in store.refs(ref.kind)
