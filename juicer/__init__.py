"""Juicer: squeeze a robot-assembly policy out of a few dozen demonstrations."""

__version__ = "0.1.0"
