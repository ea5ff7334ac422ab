"""What became of each operator log, as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flows.terminal.output import say_table
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore

if TYPE_CHECKING:
    from juicer.storage.recordings import Recording

STRETCHES_SHOWN = 4
"""Stretches of dropped steps that a line of the table names; machines get all of them."""


def find_recordings(store: ArtifactStore, ref: ArtifactRef) -> list[Recording]:
    """What became of the logs behind an artifact; empty if it was not made of logs."""
    from juicer.storage.recordings import RECORDINGS, read_recordings

    if not any(entry.path == RECORDINGS for entry in store.manifest(ref).files):
        return []
    return read_recordings(store.open(ref))


def say_recordings(recordings: list[Recording]) -> None:
    """Print the table; nothing if there are none."""
    if not recordings:
        return
    rows = [
        [
            recording.log,
            "-" if recording.episode is None else str(recording.episode),
            recording.episode_id or "-",
            "" if recording.num_steps is None else str(recording.num_steps),
            "" if recording.num_steps is None else str(recording.num_dropped),
            recording.reason or _stretches(recording.dropped),
        ]
        for recording in recordings
    ]
    say_table(
        ["log", "episode ", "id", "steps ", "idle ", "idle steps that were dropped, or why it was rejected"], rows
    )


def describe_recordings(recordings: list[Recording]) -> list[dict[str, Any]]:
    """The same for machines."""
    return [
        {
            "log": recording.log,
            "episode": recording.episode,
            "id": recording.episode_id,
            "steps": recording.num_steps,
            "dropped": [list(stretch) for stretch in recording.dropped],
            "reason": recording.reason or None,
        }
        for recording in recordings
    ]


def _stretches(dropped: tuple[tuple[int, int], ...]) -> str:
    shown = [f"{first}-{last}" if last > first else str(first) for first, last in dropped[:STRETCHES_SHOWN]]
    more = len(dropped) - len(shown)
    return ", ".join([*shown, f"{more} more stretches"] if more else shown)
