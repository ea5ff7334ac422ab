"""``juicer evaluate`` from its command line."""

from __future__ import annotations

import pytest

from flows.command.evaluate import evaluate_checkpoint
from juicer.errors import ConfigError


@pytest.mark.parametrize("width", [0.0, 1.0, -0.2, float("nan")])
def test_a_width_is_a_share(width: float):
    with pytest.raises(ConfigError, match=r"evaluate --until-width.*width"):
        evaluate_checkpoint("0" * 16, {}, width, as_json=False)
