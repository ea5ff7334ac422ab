"""Networks of the diffusion head: a folder each with ``config.py`` and ``network.py``, chosen by ``kind``."""
