"""Tables for people: the rows that the code works with, as pandas DataFrames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields
from enum import Enum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from _typeshed import DataclassInstance


def frame_of(
    rows: Iterable[DataclassInstance], row_type: type[DataclassInstance], **more: Iterable[Any]
) -> pd.DataFrame:
    """Rows of one type as a DataFrame with a column a field; what is not known is ``NA``.

    Args:
        rows: Instances of the type.
        row_type: Says which columns there are, also if there is no row.
        more: Further columns by name, a value a row.
    """
    import pandas as pd  # takes half a second

    frame = pd.DataFrame(map(_plain, rows), columns=[entry.name for entry in fields(row_type)])
    return frame.assign(**{name: list(values) for name, values in more.items()}).convert_dtypes()


def _plain(row: DataclassInstance) -> Mapping[str, Any]:
    return {name: value.value if isinstance(value, Enum) else value for name, value in asdict(row).items()}
