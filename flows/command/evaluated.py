"""Any episode of an evaluation, although it keeps only a few: the others are computed again from their seeds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from juicer.artifacts.explain import compare
from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import parse_config
from juicer.episode import Episode
from juicer.errors import ArtifactError, ConfigError
from juicer.policy_rollout import roll_out
from juicer.storage.episodes import EpisodeReader
from juicer.storage.evaluations import EXAMPLES, EvaluationRow, read_evaluation
from stages.evaluate import EvaluateConfig, evaluate


@dataclass(frozen=True)
class EvaluatedEpisode:
    """An episode of an evaluation.

    Attributes:
        episode: The episode, as kept or as it happened now.
        row: What the evaluation recorded of it.
        is_kept: Whether the evaluation holds it; otherwise it was computed again.
        differences: In what it differs from the record; a cause is named where one is known.
    """

    episode: Episode
    row: EvaluationRow
    is_kept: bool
    differences: tuple[str, ...] = ()


def evaluated_row(store: ArtifactStore, ref: ArtifactRef, index: int) -> EvaluationRow:
    """What an evaluation recorded of its episode of a number.

    Raises:
        ConfigError: If there is no such episode.
        ArtifactError: If the evaluation is not there, or damaged.
    """
    rows = read_evaluation(store.open(ref, "evaluation"))
    if not 0 <= index < len(rows):
        raise ConfigError(f"{ref} has episodes 0 to {len(rows) - 1}, not {index}")
    return rows[index]


def kept_episode(store: ArtifactStore, ref: ArtifactRef, row: EvaluationRow) -> EvaluatedEpisode | None:
    """The episode, if it is one of the few that the evaluation holds."""
    reader = EpisodeReader(store.open(ref, "evaluation") / EXAMPLES)
    for place, record in enumerate(reader.records):
        if record.seed == row.seed:
            return EvaluatedEpisode(reader.read(place), row, is_kept=True)
    return None


def recomputed_episode(
    store: ArtifactStore, ref: ArtifactRef, row: EvaluationRow, device: str = "cpu"
) -> EvaluatedEpisode:
    """The episode computed again with the same policy, initial state, shift and noise, acting on a torch device.

    Raises:
        ArtifactError: If the checkpoint is not there, or damaged.
        ConfigError: If this version does not know the evaluation's configuration.
    """
    manifest = store.manifest(ref)
    checkpoint = _checkpoint_of(manifest)
    config = parse_config(manifest.recipe.config, EvaluateConfig, origin=f"the configuration of {ref}")
    folder = store.open(checkpoint, "checkpoint")
    (episode,) = roll_out(folder, checkpoint.id, config, [row.seed], num_envs=1, device=device, shift=config.shift)
    differences = tuple(_differences(episode, row))
    causes = tuple(_causes(store, manifest, checkpoint, config)) if differences else ()
    return EvaluatedEpisode(episode, row, False, differences + causes)


def _checkpoint_of(manifest: Manifest) -> ArtifactRef:
    try:
        return manifest.recipe.inputs["checkpoint"][0]
    except (KeyError, IndexError):
        raise ArtifactError(f"{manifest.ref} does not say which checkpoint it is of") from None


def _differences(episode: Episode, row: EvaluationRow) -> Iterator[str]:
    record = episode.record
    if record.outcome is not row.outcome:
        yield f"it ends as {record.outcome.value}, not as {row.outcome.value}"
    if len(episode) != row.length:
        yield f"it takes {len(episode)} steps, not {row.length}"
    if record.parts_assembled != row.parts_assembled:
        yield f"{record.parts_assembled} parts are assembled, not {row.parts_assembled}"
    if dict(record.milestones) != dict(row.milestones):
        yield f"it reaches {_in_words(record.milestones)}, not {_in_words(row.milestones)}"


def _in_words(milestones: Mapping[str, int]) -> str:
    return ", ".join(f"{name} at step {step}" for name, step in milestones.items()) or "no milestone"


def _causes(store: ArtifactStore, manifest: Manifest, checkpoint: ArtifactRef, config: EvaluateConfig) -> Iterator[str]:
    """What has changed since the evaluation that may be the reason."""
    previous = next(iter(manifest.recipe.inputs.get("previous", ())), None)
    today = evaluate.prepare(store, checkpoint=checkpoint, previous=previous, config=config).recipe
    changes = [difference.sentence for difference in compare(manifest.recipe, today)]
    if changes:
        yield f"since the evaluation, {', '.join(changes)}"
    else:
        yield "code and libraries are the same, so the processor or its mathematical libraries differ"
