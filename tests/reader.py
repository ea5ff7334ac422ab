"""Episodes in memory, read as stored ones are."""

from __future__ import annotations

from collections.abc import Sequence

from juicer.episode import Episode


class Reader:
    """Stands in for an ``EpisodeReader``, as far as episodes are read one by one."""

    def __init__(self, episodes: Sequence[Episode]) -> None:
        self.episodes = episodes
        self.records = [episode.record for episode in episodes]

    def __len__(self) -> int:
        return len(self.episodes)

    def read(self, index: int) -> Episode:
        return self.episodes[index]
