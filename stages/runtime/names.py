"""Names of the stages."""

STAGES = (
    "record",
    "ingest",
    "annotate",
    "augment",
    "memorise",
    "dataset",
    "train",
    "collect",
    "select",
    "evaluate",
    "report",
)
"""In the order of the loop."""
