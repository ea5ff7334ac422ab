"""No purpose is given the initial states of another."""

from __future__ import annotations

from itertools import pairwise

import pytest

from juicer.errors import ConfigError
from juicer.seed_ranges import SEED_RANGES, Purpose, check_seeds, claim


def test_no_initial_state_belongs_to_two_purposes():
    ranges = sorted(SEED_RANGES.values(), key=lambda owned: owned.start)
    assert all(left.stop <= right.start for left, right in pairwise(ranges))
    assert set(SEED_RANGES) == set(Purpose)


def test_pre_registered_evaluation_states_have_not_moved():
    assert claim(Purpose.EVALUATION, 0, 100) == range(3_000_000, 3_000_100)


def test_claim_takes_a_purpose_by_name():
    assert claim("collection", 5, 2) == range(1_000_005, 1_000_007)


@pytest.mark.parametrize(("start", "count"), [(-1, 1), (0, 0), (0, 1_000_001), (999_999, 2)])
def test_claim_refuses_to_leave_the_range(start: int, count: int):
    with pytest.raises(ConfigError, match="positions are 0 to 999999"):
        claim(Purpose.COLLECTION, start, count)


def test_claim_suggests_the_nearest_purpose():
    with pytest.raises(ConfigError, match="did you mean 'evaluation'"):
        claim("evalutaion", 0, 1)


def test_a_seed_of_another_purpose_is_refused():
    check_seeds(Purpose.DEMONSTRATIONS, range(3))
    with pytest.raises(ConfigError, match="seed 3000000 must not be used for demonstrations"):
        check_seeds(Purpose.DEMONSTRATIONS, [1, 3_000_000])
