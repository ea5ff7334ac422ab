"""Names of the stages: every module of this package's parent is one."""

from __future__ import annotations

from pathlib import Path

STAGES = tuple(sorted(path.stem for path in Path(__file__).parents[1].glob("[a-z]*.py")))
