"""Labels files written by juicer: critical states to be corrected by hand, and files of an earlier juicer anew.

These have the column ``episode`` instead of ``recording``, a number that shifts with every log that is added, and count
steps of the episode. They are read for no other purpose than to be rewritten.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from juicer.annotation.labels import (
    COLUMNS,
    NUMBERED_COLUMNS,
    Label,
    distinct,
    read_rows,
    reader_of,
    step_and_state,
    whole_number,
)
from juicer.episode import DemonstrationReader
from juicer.errors import InvalidLabels
from juicer.storage.annotations import Annotation
from juicer.text import printable

_WRITERS: Mapping[str, Callable[[Any], str]] = {
    ".csv": lambda table: str(table.to_csv(index=False)),
    ".jsonl": lambda table: str(table.to_json(orient="records", lines=True)),
    **dict.fromkeys((".yaml", ".yml"), lambda table: yaml.safe_dump(table.to_dict("records"), sort_keys=False)),
}


def read_numbered_labels(path: Path, demonstrations: DemonstrationReader) -> list[Label]:
    """Read a labels file of an earlier juicer, as labels of today.

    Args:
        path: The file, whose columns are ``episode``, ``step`` and ``critical_state``.
        demonstrations: The episodes that it numbers, and whose steps it counts.

    Raises:
        InvalidLabels: See :func:`read_labels`; and if there is no such episode or step.
    """
    labels = []
    for where, values in read_rows(path, NUMBERED_COLUMNS):
        number = whole_number(values["episode"], "episode", where)
        step, critical_state = step_and_state(values, where)
        if number >= len(demonstrations):
            raise InvalidLabels(
                f"{where}: there is no episode {number}; episodes are numbered 0 to {len(demonstrations) - 1}"
            )
        episode = demonstrations.read(number)
        if step >= len(episode):
            raise InvalidLabels(f"{where}: episode {number} has no step {step}; it has {len(episode)} steps")
        labels.append(Label(episode.record.episode_id, episode.recorded_step(step), critical_state, where))
    return distinct(labels)


def labels_of(annotations: Iterable[Annotation], demonstrations: DemonstrationReader) -> list[Label]:
    """Annotations as labels, e.g. to correct some of them by hand."""
    numbers = {record.episode_id: number for number, record in enumerate(demonstrations.records)}
    return [
        Label(
            row.episode_id,
            demonstrations.read(numbers[row.episode_id]).recorded_step(row.step),
            row.critical_state,
            row.author,
        )
        for row in annotations
    ]


def write_labels(path: Path, labels: Iterable[Label]) -> None:
    """Write a labels file, of the format that its ending names; one that is there stays as it is.

    Raises:
        InvalidLabels: If the name has another ending, the file exists, or it cannot be written.
    """
    reader_of(path)
    text = text_of(labels, path.suffix)
    draft = path.with_name(f".{path.name}.draft")
    try:
        if path.exists():
            raise InvalidLabels(f"labels file '{printable(path)}' exists already; name another")
        draft.write_text(text)
        draft.replace(path)
    except OSError as error:
        raise InvalidLabels(f"labels file '{printable(path)}' cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def text_of(labels: Iterable[Label], ending: str) -> str:
    """Labels in the format of an ending, e.g. ``.csv``.

    Raises:
        InvalidLabels: If there is no such format.
    """
    import pandas as pd  # takes half a second

    if ending not in _WRITERS:
        raise InvalidLabels(f"labels are not written as '{printable(ending)}', only as {', '.join(sorted(_WRITERS))}")
    rows = [(label.recording, label.step, label.critical_state) for label in labels]
    return _WRITERS[ending](pd.DataFrame(rows, columns=COLUMNS))
