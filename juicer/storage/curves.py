"""Training curves as JSON: numbers over steps, by name, without times, so that equal trainings leave equal files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from pydantic import TypeAdapter

from juicer.errors import ArtifactError
from juicer.progress import MetricSink
from juicer.reading import read_bounded

CURVES_FILE = "curves.json"

Curves = Mapping[str, tuple[tuple[int, ...], tuple[float, ...]]]
"""Steps and values, by name."""

MOST_BYTES = 2**28
"""Of a file of curves: millions of points."""
_POINTS = TypeAdapter(dict[str, list[tuple[int, float]]])


class CurveWriter:
    """Metric sink that keeps everything it is told in a folder, and passes it on.

    Given the same step twice, as when a killed training resumes from an earlier step, it keeps the later number.
    """

    def __init__(self, scratch: Path, listener: MetricSink) -> None:
        """Continue the curves in ``scratch``, an existing folder."""
        self._path = scratch / "curves.jsonl"
        self._listener = listener
        if self._path.exists():
            # After half a line, which a kill in mid-write leaves, the next one begins anew.
            with self._path.open("a") as file:
                file.write("\n")

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        """Record metrics at a step."""
        with self._path.open("a") as file:
            file.write(json.dumps([step, dict(metrics)]) + "\n")
        self._listener.log(metrics, step)

    def finish(self, folder: Path) -> None:
        """Write everything recorded so far as ``curves.json``."""
        points: dict[str, dict[int, float]] = {}
        for line in self._path.read_text().splitlines() if self._path.exists() else ():
            try:
                step, metrics = json.loads(line)
            except ValueError:
                continue  # half a line, or none; its step is recorded again
            for name, value in metrics.items():
                points.setdefault(name, {})[step] = value
        content = {name: sorted(curve.items()) for name, curve in sorted(points.items())}
        (folder / CURVES_FILE).write_text(json.dumps(content))


def read_curves(folder: Path) -> Curves:
    """Curves of an artifact; none if it has no such file.

    Raises:
        ArtifactError: If the file is not one that juicer wrote.
    """
    path = folder / CURVES_FILE
    try:
        content = _POINTS.validate_json(read_bounded(path, MOST_BYTES))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError):
        raise ArtifactError(f"'{path}' holds no curves that juicer wrote; make its artifact again") from None
    return {
        name: (tuple(step for step, _ in points), tuple(value for _, value in points))
        for name, points in content.items()
    }
