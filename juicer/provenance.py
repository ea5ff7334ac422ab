"""Where an episode comes from, in words: for the captions of videos, for pages and for tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from juicer.episode import EpisodeRecord, Source
from juicer.shifts import parse_shift

NOUNS: Mapping[Source, str] = {
    Source.TELEOP: "demonstration",
    Source.ROLLOUT: "rollout",
    Source.AUGMENTATION: "corrective snippet",
    Source.CORRECTION: "correction",
}
"""What an episode of each source is called, in the order of the paper's Table V, which has no corrections."""


def provenance(record: EpisodeRecord) -> list[str]:
    """What is known of where an episode comes from, an item each; the first says what it is."""
    return list(_items(record))


def _items(record: EpisodeRecord) -> Iterator[str]:
    step = "" if record.parent_step is None else f" at step {record.parent_step}"
    yield NOUNS[record.source] + (f" grown from {record.parent}{step}" if record.parent else "")
    if record.critical_state is not None:
        yield f"returns to critical state {record.critical_state}"
    if record.policy:
        yield f"policy {record.policy[:8]}"
    if record.operator:
        yield f"by {record.operator}"
    if record.device:
        yield record.device
    if record.log:
        yield record.log
    if shift := parse_shift(record.shift):
        yield shift.phrase
