"""Initial states that belong to one purpose each.

Initial states are seeds of the simulator. Each purpose owns a range of them, so that no rate is measured
on a state that a demonstration or a collected rollout has seen.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum

from juicer.errors import ConfigError, did_you_mean


class Purpose(StrEnum):
    """What initial states are drawn for."""

    DEMONSTRATIONS = "demonstrations"
    COLLECTION = "collection"
    EVALUATION = "evaluation"


SEED_RANGES: Mapping[Purpose, range] = {
    Purpose.DEMONSTRATIONS: range(1_000_000),
    Purpose.COLLECTION: range(1_000_000, 2_000_000),
    Purpose.EVALUATION: range(3_000_000, 4_000_000),
}
"""Initial-state seeds of each purpose; disjoint, and never to be moved: results refer to them."""


def claim(purpose: Purpose | str, start: int, count: int) -> range:
    """Initial-state seeds ``start`` to ``start + count`` of a purpose.

    Args:
        purpose: What the states are for.
        start: Position of the first seed within the purpose's range, counted from zero.
        count: How many.

    Raises:
        ConfigError: If the purpose is unknown, or the range does not hold that many seeds from there.
    """
    try:
        owned = SEED_RANGES[Purpose(purpose)]
    except ValueError:
        raise ConfigError(f"unknown purpose of seeds '{purpose}'{did_you_mean(str(purpose), Purpose)}") from None
    if start < 0 or count < 1 or start + count > len(owned):
        raise ConfigError(
            f"{count} initial states from position {start} were asked for {purpose}; "
            f"positions are 0 to {len(owned) - 1}, and at least one state is needed"
        )
    return owned[start : start + count]


def check_seeds(purpose: Purpose, seeds: Iterable[int]) -> None:
    """Refuse initial states that another purpose owns.

    Raises:
        ConfigError: Naming the first seed outside the purpose's range.
    """
    owned = SEED_RANGES[purpose]
    for seed in seeds:
        if seed not in owned:
            raise ConfigError(
                f"initial-state seed {seed} must not be used for {purpose}; its seeds are {owned[0]} to {owned[-1]}"
            )
