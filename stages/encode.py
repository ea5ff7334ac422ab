"""What networks that are not trained read off images: computed once over episodes, for whoever learns from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from juicer.artifacts.manifest import HEADLINE
from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.imaging.processes import ImagesOfViews
from juicer.policy.config import AnyEncoder
from juicer.policy.feature_spec import feature_spec
from juicer.storage.columns import DRAWN_BY, write_columns
from juicer.storage.episodes import EpisodeReader
from juicer.storage.selections import kept_of
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


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
    inputs={"episodes": "episodes", "selections": "selection", "estimators": "estimator"},
    libraries=("mujoco", "numpy", "torch", "zarr"),
    noun="steps with features",
    counts="steps",
    needs="device",
)
def encode(
    context: StageContext,
    *,
    episodes: ArtifactRef,
    selections: tuple[ArtifactRef, ...] = (),
    estimators: tuple[ArtifactRef, ...] = (),
    config: EncodeConfig,
) -> None:
    """Draw what an encoder that is not trained sees at every step of episodes, and keep what it makes of that.

    Of episodes that are judged, those kept are seen. An estimator is for an encoder that estimates poses.
    """
    from juicer.imaging.recorded import drawing_of
    from juicer.training.fixed import FixedEncoder  # torch takes seconds to import

    reader = EpisodeReader(context.store.open(episodes, "episodes"))
    covered = kept_of(reader, (context.store.open(each, "selection") for each in selections))
    views, workers = config.encoder.views_seen, context.machine.workers
    with drawing_of(reader, views, workers, np.flatnonzero(covered).tolist()) as drawing:
        encoder = FixedEncoder(
            config.encoder,
            {drawing.task.name: feature_spec(drawing.task.name)},
            context.machine.weights,
            [context.store.open(each, "estimator") for each in estimators],
            context.machine.device,
        )

        def features(steps: slice, images: ImagesOfViews) -> Mapping[str, NDArray[np.float32]]:
            recorded = {name: reader.steps(name, steps) for name in encoder.observes if name not in images}
            return encoder.columns({**images, **recorded})

        write_columns(
            context.draft.path,
            encoder.specs,
            drawing.episodes(context.progress, features),
            artifact=episodes.id,
            episode_ends=reader.episode_ends,
            covered=covered,
            drawn_by=drawing.drawn_by,
        )
    size = sum(math.prod(entry or 0 for entry in spec.shape) for spec in encoder.specs)
    context.draft.summary |= {
        "steps": drawing.num_steps,
        "arrays": [spec.name for spec in encoder.specs],
        DRAWN_BY: drawing.drawn_by,
        HEADLINE: f"{drawing.num_steps} steps, {size} features each",
    }
