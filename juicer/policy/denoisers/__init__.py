"""Networks of the heads that remove noise: a folder each with ``config.py`` and ``network.py``, chosen by ``kind``."""
