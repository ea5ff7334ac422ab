"""Immutable, content-addressed artifacts: what the stages read and write."""
