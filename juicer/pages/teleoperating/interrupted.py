"""Interrupted episodes: which of them the page offers, and what it shows of each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from juicer.errors import UnusableDraft
from juicer.sim.env import STEP_S
from juicer.teleoperation.drafts import DRAFTS, left_in, read_draft
from juicer.text import printable

MOST_DRAFTS = 10
"""Interrupted episodes that are offered, the latest first."""


def interrupted(folder: Path) -> list[Path]:
    """Files of interrupted episodes, the latest first.

    Args:
        folder: Where recordings lie, a folder a task.
    """
    return left_in(*folder.glob(f"*/{DRAFTS}"))[:MOST_DRAFTS]


def shown(path: Path) -> dict[str, Any]:
    """What the page shows of an interrupted episode, or why nobody can go on with it."""
    name = {"task": path.parents[1].name, "draft": path.name}
    try:
        left = read_draft(path)
    except UnusableDraft as error:
        return {**name, "problem": str(error)}
    begun = left.beginning
    return {
        **name,
        "problem": "",
        "operator": printable(begun.operator),
        "began": printable(begun.began),
        "seconds": len(left.steps) * STEP_S,
        "parent_step": begun.parent_step,
    }
