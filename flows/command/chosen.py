"""Which episode of the store a command is about, and where what is made of it goes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from juicer.errors import ConfigError, WrongArtifactKind
from juicer.text import printable

if TYPE_CHECKING:
    from flows.command.evaluated import EvaluatedEpisode
    from flows.terminal.progress import Board
    from juicer.artifacts.ref import ArtifactRef
    from juicer.artifacts.store import ArtifactStore
    from juicer.episode import Episode


@dataclass(frozen=True)
class Chosen:
    """An episode and what is known of it.

    Attributes:
        episode: The episode.
        name: What it is in its artifact, for the title.
        evaluated: What the evaluation says of it, if it is from one.
    """

    episode: Episode
    name: str
    evaluated: EvaluatedEpisode | None = None


def episode_number(store: ArtifactStore, ref: ArtifactRef, name: str) -> int:
    """Number of the episode that is meant.

    Raises:
        ConfigError: If none or several answer to the name.
    """
    if re.fullmatch(r"-?[0-9]{1,5}", name):
        return int(name)
    found: list[int] = []
    if ref.kind == "episodes":
        from juicer.episode import episodes_named
        from juicer.storage.episodes import EpisodeReader

        found = episodes_named(name, EpisodeReader(store.open(ref)).records)
    if len(found) != 1:
        several = "no episode" if not found else f"{len(found)} episodes"
        other = ", its log, or six or more digits of its id" if ref.kind == "episodes" else ""
        raise ConfigError(f"{several} of {ref} can be named '{printable(name)}'; give its number, from 0{other}")
    return found[0]


def choose(store: ArtifactStore, ref: ArtifactRef, index: int, board: Board, device: str) -> Chosen:
    """The episode of a number.

    Raises:
        ConfigError: If there is none.
        WrongArtifactKind: If the artifact holds no episodes.
        ArtifactError: If it is missing or damaged.
    """
    if ref.kind == "evaluation":
        from flows.command.evaluated import evaluated_row, kept_episode, recomputed_episode

        row = evaluated_row(store, ref, index)
        found = kept_episode(store, ref, row)
        if found is None:
            board.say(f"computing episode {index} again, which {ref} has not kept")
            found = recomputed_episode(store, ref, row, device)
        return Chosen(found.episode, f"evaluation {ref.id[:8]} episode {index}", found)
    if ref.kind != "episodes":
        raise WrongArtifactKind(f"{ref} holds no episodes to replay; see `juicer ls episodes`")
    from juicer.storage.episodes import EpisodeReader

    reader = EpisodeReader(store.open(ref))
    if not 0 <= index < len(reader):
        raise ConfigError(f"{ref} has episodes 0 to {len(reader) - 1}, not {index}")
    episode = reader.read(index)
    return Chosen(episode, f"{episode.record.source.value} {ref.id[:8]} episode {index}")


def check_place(path: Path, noun: str, suffixes: Sequence[str]) -> None:
    """Refuse what cannot be written before anything is computed.

    Args:
        path: File to write.
        noun: What it will be.
        suffixes: Endings that its name may have.

    Raises:
        ConfigError: If it has another one, its folder is not there, or it is a folder.
    """
    shown = printable(path, 500)
    if path.suffix.lower() not in suffixes:
        known = " or ".join(filter(None, (", ".join(suffixes[:-1]), suffixes[-1])))
        raise ConfigError(f"{noun} '{shown}' must end in {known}")
    try:
        has_folder, is_folder = path.parent.is_dir(), path.is_dir()
    except OSError as error:
        raise ConfigError(f"{noun} '{shown}' cannot be written: {error.strerror}") from None
    if not has_folder:
        raise ConfigError(f"folder '{printable(path.parent, 500)}' for the {noun} does not exist")
    if is_folder:
        raise ConfigError(f"{noun} '{shown}' is a folder; name a file")
