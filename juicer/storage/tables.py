"""Tables as Parquet with fixed schemas: what the modules of single tables share."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from juicer.errors import ArtifactError
from juicer.text import printable

MOST_ROWS = 10_000_000
"""Of a table: far more than any has, and no more than memory holds."""

MILESTONES = pa.map_(pa.string(), pa.int32())
"""Step at which each milestone was first reached, by name."""


def write_table(path: Path, schema: pa.Schema, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows as Parquet; their names and types must be those of the schema."""
    pq.write_table(pa.Table.from_pylist(list(rows), schema=schema), path)


def read_table(
    path: Path, schema: pa.Schema, optional: Collection[str] = (), older: pa.Schema | None = None
) -> list[dict[str, Any]]:
    """Read every row of a Parquet file; map columns become dictionaries.

    Args:
        path: The file.
        schema: Names and types of its columns.
        optional: Columns that need not have a value in every row.
        older: What an earlier juicer wrote: what it lacks is None, what there is no place for today is left out.

    Raises:
        ArtifactError: If the file is missing, has another schema, lacks values, or has absurdly many rows.
    """
    try:
        with pq.ParquetFile(path) as file:
            if file.metadata.num_rows > MOST_ROWS:
                raise ArtifactError(f"'{path}' has {file.metadata.num_rows:,} rows; juicer reads {MOST_ROWS:,}")
            table = file.read()
    except (OSError, pa.ArrowException):
        raise ArtifactError(f"'{path}' is not a Parquet table that juicer wrote") from None
    if older is not None and table.schema.equals(older):
        for name in schema.names:
            if name not in older.names:
                table = table.append_column(name, pa.nulls(len(table), schema.field(name).type))
        table = table.select(schema.names)
    if not table.schema.equals(schema):
        names = printable(table.schema.names)
        raise ArtifactError(
            f"'{path}' has the columns {names} of another version; expected {schema.names}; "
            "run the flow that made its artifact again, which makes its successor"
        )
    for name in schema.names:
        if name not in optional and table.column(name).null_count:
            raise ArtifactError(f"'{path}' lacks values in its column '{name}'; make its artifact again")
    try:
        rows: list[dict[str, Any]] = table.to_pylist(maps_as_pydicts="strict")
    except (pa.ArrowException, KeyError, ValueError) as error:
        raise ArtifactError(f"'{path}' is not a table that juicer wrote: {printable(error)}") from None
    return rows
