"""Demonstrations by whatever operator: logs, recording, ingestion."""
