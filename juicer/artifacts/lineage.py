"""In which order artifacts come after those they were made from."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from juicer.artifacts.ref import ArtifactRef


def parents_first(
    refs: Iterable[ArtifactRef], parents_of: Callable[[ArtifactRef], Iterable[ArtifactRef]]
) -> list[ArtifactRef]:
    """Artifacts and everything they were made from, each once, parents before children.

    Args:
        refs: The artifacts.
        parents_of: What one was made from; asked once for each.
    """
    order: dict[ArtifactRef, None] = {}
    # A stack of its own: a chain of artifacts may be longer than Python's.
    waiting = [(ref, False) for ref in reversed([*refs])]
    while waiting:
        ref, has_parents = waiting.pop()
        if has_parents:
            order[ref] = None
        elif ref not in order:
            waiting.append((ref, True))
            waiting += [(parent, False) for parent in reversed([*parents_of(ref)])]
    return [*order]
