"""Critical states of a loop's demonstrations, proposed or as people say."""

from __future__ import annotations

from flows.loop_config import LoopConfig
from juicer.annotation.holding import hold
from juicer.annotation.versions import is_versions
from juicer.artifacts.ref import ArtifactRef
from stages.annotate import annotate
from stages.runtime.session import Session


def annotations_of(session: Session, config: LoopConfig, demonstrations: ArtifactRef) -> ArtifactRef:
    """Critical states of a loop's demonstrations; what people say of them is what they had said when the run began."""
    labels = config.labels
    if labels is not None and is_versions(labels):
        if labels not in session.held:
            session.held.setdefault(labels, hold(labels, session.store.cache / "labels" / "used"))
        labels = session.held[labels]
    return annotate(session, episodes=demonstrations, labels=labels, config=config.annotate)
