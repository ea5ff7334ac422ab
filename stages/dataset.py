"""What a policy learns from: an index of episodes, which copies none of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from juicer.artifacts.ref import ArtifactRef
from juicer.errors import ArtifactError
from juicer.storage.columns import DRAWN_BY, ColumnReader
from juicer.storage.dataset import DatasetRow, write_dataset
from juicer.storage.episodes import EpisodeReader
from juicer.storage.selections import read_judgements
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
    judged = read_judgements(context.store.open(ref, "selection") for ref in selections)
    derived = {ref: ColumnReader(context.store.open(ref, "columns")) for ref in columns}
    own = _columns_of(episodes, derived)
    # Joined, so that columns which do not match are refused here, and not by a training.
    readers = [
        EpisodeReader(context.store.open(ref, "episodes"), [derived[each].folder for each in own[ref.id]])
        for ref in episodes
    ]
    given = [
        GivenEpisodes(ref.id, reader.records, reader.lengths.tolist(), tuple(each.id for each in own[ref.id]))
        for ref, reader in zip(episodes, readers, strict=True)
    ]
    rows = mix(given, judged, config)
    _require_covered(rows, readers)
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
    if drawn_by := sorted({name for reader in derived.values() for name in reader.drawn_by}):
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


def _require_covered(rows: Sequence[DatasetRow], readers: Sequence[EpisodeReader]) -> None:
    """Refuse episodes that columns leave out, as those that a selection did not keep.

    Raises:
        ArtifactError: If there is one.
    """
    taken = {row.episode_id for row in rows}
    for reader in readers:
        for record, covered in zip(reader.records, reader.covered, strict=True):
            if record.episode_id in taken and not covered:
                raise ArtifactError(
                    f"columns given of episodes/{reader.folder.name} do not cover its episode {record.episode_id}; "
                    "give the selections that they were made with, or make columns of all of its episodes"
                )
