"""Heads, which choose actions: a folder each with ``config.py`` and ``network.py``, chosen by ``kind``."""
