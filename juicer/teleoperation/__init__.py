"""Demonstrations at their source: operator logs, and a scripted operator that stands in for a human."""
