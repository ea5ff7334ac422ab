"""Features of images by a network that is not trained: computed once over episodes, for whoever learns from them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from juicer.artifacts.manifest import HEADLINE
from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.policy.config import AnyEncoder
from juicer.storage.columns import DRAWN_BY, ColumnReader, write_columns
from juicer.storage.episodes import EpisodeReader
from stages.runtime.context import StageContext
from stages.runtime.stage import stage

BATCH = 64
"""Steps that go through the network at once."""


class EncodeConfig(StrictConfig):
    """What computes the features; it must have nothing to learn."""

    encoder: AnyEncoder

    @model_validator(mode="after")
    def _has_fixed_features(self) -> Self:
        if not self.encoder.fixed_parts:
            raise ValueError(f"an encoder '{self.encoder.kind}' that is not frozen has no features to keep")
        return self


@stage(
    kind="columns",
    inputs={"episodes": "episodes", "images": "columns"},
    libraries=("numpy", "torch", "zarr"),
    noun="steps with features",
    counts="steps",
    needs="device",
)
def encode(
    context: StageContext, *, episodes: ArtifactRef, images: tuple[ArtifactRef, ...], config: EncodeConfig
) -> None:
    """Run an encoder that is not trained over episodes and images of them."""
    from juicer.training.fixed import FixedEncoder  # torch takes seconds to import

    folders = [context.store.open(ref, "columns") for ref in images]
    reader = EpisodeReader(context.store.open(episodes, "episodes"), folders)
    encoder = FixedEncoder(config.encoder, context.machine.weights, context.machine.device)
    drawn_by = sorted({name for folder in folders for name in ColumnReader(folder).drawn_by})
    chosen = np.flatnonzero(reader.covered)
    total = int(reader.lengths[chosen].sum())

    def columns() -> Iterator[Mapping[str, NDArray[np.float32]]]:
        done = 0
        for (episode,) in (reader.spans([index]) for index in chosen.tolist()):
            parts = []
            for first in range(episode.start, episode.stop, BATCH):
                span = slice(first, min(first + BATCH, episode.stop))
                parts.append(encoder.columns({name: reader.steps(name, span) for name in encoder.observes}))
                done += span.stop - span.start
                context.progress(done, total)
            yield {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    write_columns(
        context.draft.path,
        encoder.specs,
        columns(),
        artifact=episodes.id,
        episode_ends=reader.episode_ends,
        covered=reader.covered,
        drawn_by=drawn_by,
    )
    size = sum(math.prod(entry or 0 for entry in spec.shape) for spec in encoder.specs)
    context.draft.summary |= {
        "steps": total,
        "arrays": [spec.name for spec in encoder.specs],
        DRAWN_BY: drawn_by,
        HEADLINE: f"{total} steps, {size} features each",
    }
