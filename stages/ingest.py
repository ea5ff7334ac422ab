"""Operator logs become demonstrations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from juicer.artifacts.ref import ArtifactRef
from juicer.episode import Episode
from juicer.errors import NothingLeft
from juicer.ingestion import IngestionConfig, Rejection
from juicer.ingestion import ingest as ingest_logs
from juicer.storage.episodes import write_episodes
from juicer.teleoperation.log import SUFFIX
from stages.stage import StageContext, stage

REJECTIONS_SHOWN = 100


@stage(kind="episodes", inputs={"logs": "logs"}, libraries=("mujoco", "numpy", "zarr"))
def ingest(
    context: StageContext, *, logs: ArtifactRef | None = None, files: tuple[Path, ...] = (), config: IngestionConfig
) -> None:
    """Turn operator logs into demonstrations; bad ones are rejected one by one, with a reason."""
    paths = sorted(files, key=lambda path: path.name)
    if logs is not None:
        folder = context.store.open(logs, "logs")
        # Not whatever lies there: an operating system may have left files of similar names.
        paths += [folder / entry.path for entry in context.store.manifest(logs).files if entry.path.endswith(SUFFIX)]
    tally = _Tally()
    episodes = tally.keep(ingest_logs(paths, config, context.progress))
    try:
        write_episodes(context.draft.path, episodes, {"source": "teleop", "task": config.task})
    except NothingLeft:
        reason = tally.rejected[0].reason if tally.rejected else "there were none"
        raise NothingLeft(
            f"no demonstration is left of {len(paths)} operator logs; the first reason: {reason}"
        ) from None
    context.draft.summary |= tally.facts(len(paths))


class _Tally:
    """Counts what passes by."""

    def __init__(self) -> None:
        self.rejected: list[Rejection] = []
        self._lengths: list[int] = []
        self._devices: Counter[str] = Counter()

    def keep(self, results: Iterable[Episode | Rejection]) -> Iterator[Episode]:
        for result in results:
            if isinstance(result, Rejection):
                self.rejected.append(result)
                continue
            self._lengths.append(len(result))
            self._devices[result.record.device or "unknown"] += 1
            yield result

    def facts(self, num_logs: int) -> dict[str, object]:
        return {
            "logs": num_logs,
            "episodes": len(self._lengths),
            "rejected": len(self.rejected),
            "steps": sum(self._lengths),
            "mean_length": sum(self._lengths) / len(self._lengths),
            "devices": dict(self._devices),
            "rejections": {entry.source: entry.reason for entry in self.rejected[:REJECTIONS_SHOWN]},
        }
