"""Regression of the whole action chunk: the baseline."""
