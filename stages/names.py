"""Names of the stages."""

STAGES = ("record", "ingest", "annotate", "augment", "train", "collect", "select", "evaluate", "report")
"""In the order of the loop."""
