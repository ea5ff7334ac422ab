"""File formats of the artifacts: episodes in Zarr, tables in Parquet."""
