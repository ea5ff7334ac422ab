"""Operator logs become demonstrations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from juicer.artifacts.ref import ArtifactRef
from juicer.demonstration.ingestion import Demonstration, IngestionConfig, UnusableLog
from juicer.demonstration.ingestion import ingest as ingest_logs
from juicer.demonstration.log import SUFFIX
from juicer.demonstration.recording import minutes_of
from juicer.episode import Episode, Source
from juicer.errors import NothingLeft
from juicer.storage.episodes import write_episodes
from juicer.storage.recordings import Recording, write_recordings
from stages.runtime.context import StageContext
from stages.runtime.stage import stage

REJECTIONS_SHOWN = 100
REASONS_TOLD = 10
"""Rejections that the message of a stage that failed repeats."""
DEVICES_SHOWN = 20


@stage(
    kind="episodes",
    inputs={"logs": "logs"},
    libraries=("mujoco", "numpy", "zarr"),
    noun="demonstrations",
    counts="episodes",
    headline=("episodes", "rejected", "logs", "steps"),
)
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
        raise NothingLeft(f"no demonstration is left of {len(paths)} operator logs; {tally.reasons()}") from None
    write_recordings(context.draft.path, tally.recordings)
    context.draft.summary |= tally.facts()


class _Tally:
    """Notes what becomes of each log that passes by."""

    def __init__(self) -> None:
        self.recordings: list[Recording] = []
        self._devices: Counter[str] = Counter()
        self._recorded_steps = self._corrections = 0

    def keep(self, results: Iterable[Demonstration | UnusableLog]) -> Iterator[Episode]:
        episodes = 0
        for result in results:
            self._recorded_steps += result.num_steps
            if isinstance(result, UnusableLog):
                self.recordings.append(Recording(result.source, reason=result.reason))
                continue
            kept = tuple(result.kept.tolist())
            record = result.episode.record
            self.recordings.append(Recording(result.source, episodes, record.episode_id, result.num_steps, kept))
            self._devices[record.device or "unknown"] += 1
            self._corrections += record.source is Source.CORRECTION
            episodes += 1
            yield result.episode

    def reasons(self) -> str:
        """Why logs were rejected, for a message."""
        rejected = self._rejected
        if not rejected:
            return "the first reason: there were none"
        told = "; ".join(f"{entry.log}: {entry.reason}" for entry in rejected[1:REASONS_TOLD])
        more = f"; and {len(rejected) - REASONS_TOLD} more" if len(rejected) > REASONS_TOLD else ""
        return f"the first reason: {rejected[0].reason} ({rejected[0].log})" + (f"; {told}" if told else "") + more

    def facts(self) -> dict[str, object]:
        rejected = self._rejected
        kept = [entry for entry in self.recordings if entry.episode is not None]
        steps = sum(len(entry.kept) for entry in kept)
        return {
            "logs": len(self.recordings),
            "episodes": len(kept),
            "corrections": self._corrections,
            "rejected": len(rejected),
            "steps": steps,
            "idle_steps_dropped": sum(entry.num_dropped for entry in kept),
            "mean_length": steps / len(kept),
            "operator_minutes": minutes_of(self._recorded_steps),
            "devices": dict(self._devices.most_common(DEVICES_SHOWN)),
            "rejections": {entry.log: entry.reason for entry in rejected[:REJECTIONS_SHOWN]},
        }

    @property
    def _rejected(self) -> list[Recording]:
        return [entry for entry in self.recordings if entry.reason]
