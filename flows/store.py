"""The artifact store that this machine's settings name. Light, for commands that only look into it."""

from __future__ import annotations

from flows.settings import Settings
from juicer.artifacts.store import ArtifactStore


def open_store(settings: Settings) -> ArtifactStore:
    """The artifact store of this process."""
    return ArtifactStore(settings.store_url, cache=settings.folder / "cache")
