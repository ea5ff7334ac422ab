"""Addresses of pages, for whoever links to them."""

from __future__ import annotations


def lineage_of(artifact: str, pages: str = "") -> str:
    """Where an artifact's lineage is shown.

    Args:
        artifact: The artifact, as ``kind/id``.
        pages: Address of the server of the pages; without it, as its own pages link to it.
    """
    return f"{pages}/lineage?artifact={artifact}"
