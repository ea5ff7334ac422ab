"""``juicer labels``: critical states as a file that a person can correct."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from flows.running.data_folder import open_store
from flows.running.settings import read_settings
from flows.terminal.output import say
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ConfigError, WrongArtifactKind

if TYPE_CHECKING:
    from juicer.annotation.labels import Label


def write_labels_file(text: str, path: Path, numbered: Path | None) -> None:
    """``juicer labels``."""
    from juicer.annotation.rewriting import write_labels

    store = open_store(read_settings())
    ref = store.resolve(text)
    labels = _annotated(store, ref) if numbered is None else _renamed(store, ref, numbered)
    write_labels(path, labels)
    say(f"{path}: {len(labels)} critical states")


def _annotated(store: ArtifactStore, ref: ArtifactRef) -> list[Label]:
    from juicer.annotation.rewriting import labels_of
    from juicer.storage.episodes import EpisodeReader
    from juicer.storage.tables import read_annotations

    if ref.kind != "annotations":
        raise WrongArtifactKind(f"{ref} holds no critical states; see `juicer ls annotations`")
    (episodes,) = store.manifest(ref).recipe.inputs["episodes"]
    return labels_of(read_annotations(store.open(ref)), EpisodeReader(store.open(episodes, "episodes")))


def _renamed(store: ArtifactStore, ref: ArtifactRef, numbered: Path) -> list[Label]:
    from juicer.annotation.rewriting import read_numbered_labels
    from juicer.episode import RECORDED_STEP_KEY
    from juicer.storage.episodes import EpisodeReader

    if ref.kind != "episodes":
        raise ConfigError(f"{ref} holds no episodes; with --numbered, name those that the file numbers")
    reader = EpisodeReader(store.open(ref, "episodes"))
    if len(reader) and RECORDED_STEP_KEY not in reader.schema:
        raise ConfigError(
            f"{ref} does not know the steps of its recordings; "
            "ingest the same logs with this juicer, and name the result"
        )
    return read_numbered_labels(numbered, reader)
