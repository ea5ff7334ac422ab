"""Networks from images to features: a folder each with ``config.py`` and ``network.py``, chosen by ``kind``."""
