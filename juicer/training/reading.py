"""Episodes of a dataset, read from where they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from juicer.episode import Role
from juicer.errors import ArtifactError
from juicer.policy.tasks import Tasks, as_shown
from juicer.storage.arrays import Array
from juicer.storage.dataset import DatasetRow
from juicer.storage.episodes import EpisodeReader
from juicer.training.windows import TrainingEpisodes


def read_episodes(
    reader: EpisodeReader, rows: Sequence[DatasetRow], tasks: Tasks, names: Sequence[str] | None = None
) -> TrainingEpisodes:
    """Episodes of one task and artifact, for a policy that learns some tasks.

    Args:
        reader: The artifact, with the columns that are wanted.
        rows: Which of its episodes, in order.
        tasks: What the policy is for.
        names: Arrays that the policy is shown, those of columns among them; what was observed if None.

    Raises:
        ArtifactError: If the artifact lacks an episode or an array.
    """
    chosen = [reader.find(row.episode_id) for row in rows]
    lengths = reader.lengths[chosen]
    spans = reader.spans(chosen)

    def steps(name: str) -> Array:
        return np.concatenate([reader.steps(name, span) for span in spans])

    names = reader.schema.names(Role.OBSERVATION) if names is None else names
    for name in names:
        if name not in reader.schema:
            raise ArtifactError(
                f"the policy learns from '{name}', and the dataset has neither such an array nor such a column of the "
                f"episodes in '{reader.folder}'; make the column by the stage 'encode', or run the whole loop"
            )
    return TrainingEpisodes(
        observations=as_shown({name: steps(name) for name in names}, tasks, rows[0].task),
        actions=steps("action"),
        episode_ends=np.cumsum(lengths),
        families=[row.family for row in rows],
        sources=[row.source.value for row in rows],
        weights=[row.weight for row in rows],
    )
