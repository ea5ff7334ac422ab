"""Flows: when each stage runs, and the command line."""
