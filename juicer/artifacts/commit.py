"""Which commit of juicer's own repository runs, for people; identity never depends on it."""

from __future__ import annotations

import functools
import os
import subprocess
from pathlib import Path

UNKNOWN = "unknown"
CHANGED = " with changes that are not committed"
_PACKAGE = Path(__file__).parents[1]
_SECONDS = 5.0


@functools.cache
def source_commit() -> str:
    """Commit of the checkout that juicer runs from, as it was when this process first asked.

    Returns:
        Forty hexadecimal digits, followed by :data:`CHANGED` if the code differs from the commit; :data:`UNKNOWN` if
        juicer is installed without its repository, or git is not there.
    """
    return commit_of(_PACKAGE)


def commit_of(package: Path) -> str:
    """The same for the folder of a package."""
    # A package that lies in somebody else's repository, as a virtual environment may, is not of its commit.
    if not _git(package, "ls-files", "--error-unmatch", "__init__.py"):
        return UNKNOWN
    commit, changes = _git(package, "rev-parse", "HEAD"), _git(package.parent, "status", "--porcelain", "-uno")
    if not commit or changes is None:
        return UNKNOWN
    return commit + (CHANGED if changes else "")


def _git(folder: Path, *arguments: str) -> str | None:
    """What git prints; none if it fails."""
    # Variables such as GIT_DIR, which hooks set, would point to another repository.
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    environment |= {"GIT_OPTIONAL_LOCKS": "0"}
    try:
        result = subprocess.run(
            ["git", "-C", str(folder), *arguments],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_SECONDS,
            env=environment,
            stdin=subprocess.DEVNULL,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return result.stdout.strip() if result.returncode == 0 else None
