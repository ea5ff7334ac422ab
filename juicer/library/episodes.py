"""Episodes of an artifact, as one looks at them in Python."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from juicer.episode import Episode, EpisodeRecord
from juicer.errors import ArtifactError
from juicer.library.tables import episode_table
from juicer.sim.arguments import is_whole, shown
from juicer.storage.episodes import EpisodeReader


class Episodes(EpisodeReader):
    """Stored episodes; arrays are read from disk when asked for."""

    @property
    def table(self) -> pd.DataFrame:
        """A row an episode, by its number, and a column for the step at which each milestone was reached."""
        table = episode_table(self.records, EpisodeRecord)
        table.insert(0, "length", self.lengths)
        return table.rename_axis(index="episode")

    def __getitem__(self, key: int | str) -> Episode:
        """The episode of a number, which may count from the end, or of an id.

        Raises:
            ArtifactError: If there is none.
        """
        if isinstance(key, str):
            return self.read(self.find(key))
        if not is_whole(key) or not -len(self) <= key < len(self):
            raise ArtifactError(f"there are {len(self)} episodes, numbered from 0, and none is {shown(key)}")
        return self.read(int(key))

    def __iter__(self) -> Iterator[Episode]:
        """Every episode in order."""
        return map(self.read, range(len(self)))
