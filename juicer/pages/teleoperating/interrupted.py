"""Episodes that were interrupted: which are offered, what is told of each, and why one cannot be gone on with."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from juicer.errors import UnusableDraft
from juicer.sim.env import STEP_S
from juicer.teleoperation.drafts import DRAFTS, SUFFIX, LeftDraft, left_in, read_draft
from juicer.text import printable

MOST_DRAFTS = 10
"""Interrupted episodes that are offered, the latest first."""


def interrupted(folder: Path) -> list[Path]:
    """Files of interrupted episodes, the latest first; those that the disk lets nobody go on with are among them.

    Args:
        folder: Where recordings lie, a folder a task.
    """
    folders = [*folder.glob(f"*/{DRAFTS}")]
    refused = [path for each in folders for path in each.glob(f"[!.]*{SUFFIX}") if _refusal(path)]
    return sorted({*left_in(*folders), *refused}, key=_written_s, reverse=True)[:MOST_DRAFTS]


def read_interrupted(path: Path) -> LeftDraft:
    """Read an interrupted episode, to go on with it.

    Raises:
        UnusableDraft: If nobody can go on with it: it is damaged, or the disk refuses it.
    """
    if refusal := _refusal(path):
        raise UnusableDraft(
            f"nobody can go on with draft '{printable(path)}', as it cannot be written ({refusal}); mount its disk for "
            "writing, or see to its permissions, and reload this page"
        )
    return read_draft(path)


def told_of(path: Path) -> dict[str, Any]:
    """What is told of an interrupted episode; why it cannot be gone on with, if it cannot."""
    name = {"task": path.parents[1].name, "draft": path.name}
    try:
        left = read_interrupted(path)
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


def _written_s(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:  # gone meanwhile
        return 0.0


def _refusal(path: Path) -> str:
    """Why the disk does not let a draft be written; empty if it does, or the draft is gone."""
    try:
        os.close(os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NONBLOCK))
    except FileNotFoundError:
        return ""
    except OSError as error:
        return error.strerror or str(error)
    return ""
