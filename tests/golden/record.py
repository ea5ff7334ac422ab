"""Record the golden values of this environment: ``python -m tests.golden.record``, from the repository's root."""

from __future__ import annotations

import logging
import time
from typing import Any

from tests.golden.golden import CASES
from tests.golden.values import PATH, load_values, merged, save_values

logger = logging.getLogger(__name__)


def main() -> None:
    """Compute every case and write its value down."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    new: dict[str, dict[str, Any]] = {}
    for name, case in CASES.items():
        started = time.monotonic()
        new.setdefault(case.environment, {})[name] = case.compute()
        logger.info("%5.1f s  %s", time.monotonic() - started, name)
    save_values(merged(load_values(), new))
    logger.info("written: %s", PATH)


if __name__ == "__main__":
    main()
