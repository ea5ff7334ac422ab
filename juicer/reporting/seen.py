"""What the policy of an evaluation looked at, as its training says."""

from __future__ import annotations

from pydantic import ValidationError

from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError
from juicer.policy.config import PolicyConfig
from juicer.reporting.lineage import checkpoint_of
from juicer.views import View


def views_of(store: ArtifactStore, evaluation: ArtifactRef) -> tuple[View, ...]:
    """Views; none of a policy that sees no images, or of which nothing is known any more."""
    try:
        checkpoint = checkpoint_of(store.manifest(evaluation))
        config = store.manifest(checkpoint).recipe.config if checkpoint else {}
    except ArtifactError:
        return ()
    try:
        return PolicyConfig.model_validate(config["policy"]).views_seen if "policy" in config else ()
    except ValidationError:  # of a package that is no longer installed
        return ()
