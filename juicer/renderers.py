"""Whether a policy that looks was shown images of the renderer whose images it had learned from."""

from __future__ import annotations

from collections.abc import Mapping

from juicer.artifacts.manifest import FINDING
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.sim.env import gl_name
from juicer.storage.columns import DRAWN_BY
from juicer.text import printable


def renderer_facts(
    store: ArtifactStore, checkpoint: ArtifactRef, begun: ArtifactRef | None = None
) -> dict[str, object]:
    """What drew the images that a policy was shown in this process, for a summary; nothing if it sees none.

    There is a finding if it had learned from those of other renderers.

    Args:
        store: Where both are.
        checkpoint: The policy.
        begun: What this goes on from, perhaps made on another machine; what drew its images counts as well.

    Raises:
        RenderingUnavailable: If no OpenGL platform can draw.
    """
    learned_from = _drawn_by(store.manifest(checkpoint).summary)
    if not learned_from:
        return {}
    shown = {gl_name(), *(_drawn_by(store.manifest(begun).summary) if begun else ())}
    facts: dict[str, object] = {DRAWN_BY: sorted(shown)}
    if others := shown - set(learned_from):
        by, of = (printable(" and ".join(names)) for names in (sorted(others), learned_from))
        facts[FINDING] = f"it saw images drawn by {by}, and had learned from those of {of}"
    return facts


def _drawn_by(summary: Mapping[str, list[str]]) -> list[str]:
    return summary.get(DRAWN_BY, [])
