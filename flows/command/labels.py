"""``juicer labels``: critical states as a file that a person can correct, and such a file among what people said."""

from __future__ import annotations

from datetime import datetime
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
    from juicer.storage.episodes import EpisodeReader


def write_labels_file(text: str, path: Path, numbered: Path | None) -> None:
    """``juicer labels``."""
    from juicer.annotation.rewriting import write_labels

    settings = read_settings()
    store = open_store(settings)
    ref = store.resolve(text)
    labels = _annotated(store, ref, settings.folder) if numbered is None else _renamed(store, ref, numbered)
    write_labels(path, labels)
    say(f"{path}: {len(labels)} critical states")


def import_labels_file(text: str, path: Path, author: str) -> None:
    """``juicer labels --import-as``: every label becomes a version, as if its author had marked it on the page."""
    from juicer import __version__
    from juicer.annotation.importing import import_labels
    from juicer.annotation.labels import read_labels
    from juicer.annotation.versions import versions_path

    settings = read_settings()
    reader, task = _episodes(open_store(settings), text)
    versions = versions_path(settings.folder, task)
    time = datetime.now().astimezone().isoformat(timespec="seconds")
    saved = import_labels(versions, read_labels(path), reader, author, f"juicer {__version__}, import", time)
    say(f"{versions}: {len(saved)} critical states more")


def _annotated(store: ArtifactStore, ref: ArtifactRef, folder: Path) -> list[Label]:
    from juicer.annotation.rewriting import labels_of
    from juicer.annotation.standing import agreed_labels
    from juicer.annotation.versions import read_versions, versions_path
    from juicer.storage.annotations import read_annotations
    from juicer.storage.episodes import EpisodeReader

    if ref.kind == "episodes":
        reader, task = _episodes(store, str(ref))
        path = versions_path(folder, task)
        labels = [label for label in agreed_labels(read_versions(path), path) if label.recording in reader.ids]
        if not labels:
            raise ConfigError(
                f"nobody has marked a critical state of {ref} on the page that `juicer pages` serves; "
                "what was proposed is in annotations, see `juicer ls annotations`"
            )
        return labels
    if ref.kind != "annotations":
        raise WrongArtifactKind(f"{ref} holds no critical states; see `juicer ls annotations` and `juicer ls episodes`")
    (episodes,) = store.manifest(ref).recipe.inputs["episodes"]
    return labels_of(read_annotations(store.open(ref)), EpisodeReader(store.open(episodes, "episodes")))


def _episodes(store: ArtifactStore, text: str) -> tuple[EpisodeReader, str]:
    """Episodes of an artifact, and their task."""
    from juicer.storage.episodes import EpisodeReader

    ref = store.resolve(text)
    reader = EpisodeReader(store.open(ref, "episodes"))
    if not len(reader):
        raise ConfigError(f"{ref} holds no episode, so there is nothing to annotate")
    return reader, reader.records[0].task


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
