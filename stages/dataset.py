"""What a policy learns from: an index of episodes, which copies none of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from juicer.artifacts.ref import ArtifactRef
from juicer.errors import ArtifactError
from juicer.storage.columns import DRAWN_BY, ColumnReader
from juicer.storage.dataset import write_dataset
from juicer.storage.episodes import EpisodeReader
from juicer.storage.selections import read_selection
from juicer.text import printable
from juicer.training.mixing import DatasetConfig, GivenEpisodes, mix
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


@stage(
    kind="dataset",
    inputs={"episodes": "episodes", "selections": "selection", "columns": "columns"},
    noun="episodes",
    counts="episodes",
    headline=("episodes", "steps"),
)
def dataset(
    context: StageContext,
    *,
    episodes: tuple[ArtifactRef, ...],
    selections: tuple[ArtifactRef, ...] = (),
    columns: tuple[ArtifactRef, ...] = (),
    config: DatasetConfig,
) -> None:
    """Choose and weigh episodes; those that a selection judges are taken only if it keeps them."""
    judged: dict[str, bool] = {}
    for ref in selections:
        for row in read_selection(context.store.open(ref, "selection")):
            judged[row.episode_id] = judged.get(row.episode_id, True) and row.keep
    readers = {ref: ColumnReader(context.store.open(ref, "columns")) for ref in columns}
    own = _columns_of(episodes, readers)
    given = [_given(context, ref, own[ref.id]) for ref in episodes]
    rows = mix(given, judged, config)
    write_dataset(context.draft.path, rows)
    lengths = {
        record.episode_id: length for each in given for record, length in zip(each.records, each.lengths, strict=True)
    }
    context.draft.summary |= {
        "episodes": len(rows),
        "steps": sum(lengths[row.episode_id] for row in rows),
        "families": len({row.family for row in rows}),
        "tasks": sorted({row.task for row in rows}),
        "sources": dict(Counter(row.source.value for row in rows)),
    }
    if drawn_by := sorted({reader.facts[DRAWN_BY] for reader in readers.values() if DRAWN_BY in reader.facts}):
        context.draft.summary[DRAWN_BY] = drawn_by


def _columns_of(
    episodes: tuple[ArtifactRef, ...], columns: Mapping[ArtifactRef, ColumnReader]
) -> dict[str, list[ArtifactRef]]:
    """Columns of each artifact of episodes, by its id.

    Raises:
        ArtifactError: If columns belong to none of them.
    """
    own: dict[str, list[ArtifactRef]] = {ref.id: [] for ref in episodes}
    for ref, reader in columns.items():
        if reader.artifact not in own:
            raise ArtifactError(
                f"{ref} are columns of episodes/{printable(reader.artifact)}, which is none of the episodes given"
            )
        own[reader.artifact].append(ref)
    return own


def _given(context: StageContext, ref: ArtifactRef, columns: list[ArtifactRef]) -> GivenEpisodes:
    # Joined, so that columns which do not match are refused here, and not by a training.
    reader = EpisodeReader(
        context.store.open(ref, "episodes"), [context.store.open(each, "columns") for each in columns]
    )
    return GivenEpisodes(ref.id, reader.records, reader.lengths.tolist(), tuple(each.id for each in columns))
