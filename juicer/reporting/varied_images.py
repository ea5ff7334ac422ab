"""Figures of the images that policies learned from, found in the lineage of their evaluations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import canonical_json
from juicer.errors import ArtifactError
from juicer.policy.config import PolicyConfig
from juicer.policy.encoders.images.config import ImagesConfig
from juicer.policy.members import EncoderConfig
from juicer.reporting.lineage import read_lineage
from juicer.storage.columns import ColumnReader
from juicer.views import View

EXAMPLES = 2
"""Images of each view."""


def varied_images(store: ArtifactStore, evaluations: Sequence[ArtifactRef]) -> Iterator[bytes]:
    """A PNG for each way in which images were varied in the trainings behind evaluations, if the images are there."""
    known = [manifest for manifest in read_lineage(store, evaluations).values() if manifest]
    drawn = {canonical_json(each.recipe.config["view"]): each.ref for each in known if each.recipe.stage == "render"}
    encoders = {
        canonical_json(encoder): encoder
        for manifest in known
        if manifest.recipe.stage == "train"
        for encoder in _encoders(manifest)
        if isinstance(encoder, ImagesConfig) and encoder.augmentation is not None
    }
    for encoder in encoders.values():
        from juicer.reporting.augmentation_examples import augmentation_examples  # torch takes seconds to import

        try:
            images = {name: _examples(store, drawn[canonical_json(view)], view) for name, view in encoder.views.items()}
        except (ArtifactError, KeyError):
            continue  # images can be drawn again at any time, so somebody may have deleted them
        yield augmentation_examples(images, encoder)


def _encoders(checkpoint: Manifest) -> Iterable[EncoderConfig]:
    try:
        return PolicyConfig.model_validate(checkpoint.recipe.config["policy"]).observation.values()
    except ValidationError:  # an older juicer's, or one with a plug-in that is not installed here
        return ()


def _examples(store: ArtifactStore, ref: ArtifactRef, view: View) -> NDArray[np.uint8]:
    reader = ColumnReader(store.open(ref, "columns"))
    first = reader.covered.argmax()
    start = reader.episode_ends[first - 1] if first else 0
    places = np.linspace(start, reader.episode_ends[first], EXAMPLES + 2)[1:-1].astype(int).tolist()
    return np.concatenate([reader.steps(view.name, slice(place, place + 1)) for place in places])
