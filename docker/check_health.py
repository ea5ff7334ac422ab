"""Exit with status 0 if the address given on the command line answers."""

from __future__ import annotations

import sys
from urllib.error import URLError
from urllib.request import urlopen


def main(address: str) -> int:
    """Status for a container's health check."""
    try:
        with urlopen(address, timeout=8) as answer:
            return 0 if answer.status == 200 else 1
    except (URLError, OSError):
        return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
