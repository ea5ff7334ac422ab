"""Features of images by a network that is not trained: computed once over episodes, for whoever learns from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.policy.config import AnyEncoder
from juicer.storage.columns import ColumnReader, write_columns
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
    headline=("steps",),
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
    total = int(reader.lengths.sum())

    def columns() -> Iterator[Mapping[str, NDArray[np.float32]]]:
        for end, length in zip(reader.episode_ends.tolist(), reader.lengths.tolist(), strict=True):
            parts = []
            for first in range(end - length, end, BATCH):
                span = slice(first, min(first + BATCH, end))
                parts.append(encoder.columns({name: reader.steps(name, span) for name in encoder.observes}))
                context.progress(span.stop, total)
            yield {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    write_columns(
        context.draft.path,
        encoder.specs,
        columns(),
        artifact=episodes.id,
        episode_ends=reader.episode_ends,
        facts={name: fact for folder in folders for name, fact in ColumnReader(folder).facts.items()},
    )
    context.draft.summary |= {"steps": total, "arrays": [spec.name for spec in encoder.specs]}
