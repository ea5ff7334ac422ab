"""Results that are meant to stay as they are, to the last digit; see "Golden values" in CONTRIBUTING.md."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.golden.golden import CASES
from tests.golden.values import load_values, merged

CHOSEN = [pytest.param(name, marks=[pytest.mark.slow] * case.slow) for name, case in CASES.items()]


@pytest.mark.parametrize("name", CHOSEN)
def test_results_stay_as_they_are(name: str):
    environment = CASES[name].environment
    recorded = load_values().get(environment, {})
    if name not in recorded:
        pytest.skip(
            f"there is no golden value for {environment}; to make one, check out a commit that you trust "
            "and run `python -m tests.golden.record`"
        )
    before, now = dict(leaves(recorded[name])), dict(leaves(CASES[name].compute()))
    drifted = [place for place in before | now if before.get(place) != now.get(place)]
    assert not drifted, (
        f"{name}: {len(drifted)} of {len(before)} values drifted, first '{drifted[0]}', "
        f"which was {before.get(drifted[0])} and is {now.get(drifted[0])}"
    )


def test_a_drift_is_named_by_its_place():
    value = {"train/loss": ["0x1p+0", "0x1p-1"], "steps": 3}
    assert dict(leaves(value)) == {"train/loss, 0": "0x1p+0", "train/loss, 1": "0x1p-1", "steps": 3}


def test_a_new_environment_is_recorded_beside_the_others():
    assert merged({"a": {"loss": 1}}, {"b": {"loss": 2}}) == {"a": {"loss": 1}, "b": {"loss": 2}}


def test_a_changed_result_drops_what_other_environments_recorded_before_it():
    assert merged({"a": {"loss": 1}, "b": {"loss": 1}}, {"a": {"loss": 2}}) == {"a": {"loss": 2}}
    old = {"a": {"loss": 1, "rate": 3}, "b": {"loss": 1, "rate": 4}}
    new = {"a": {"loss": 2, "rate": 3}}
    assert merged(old, new) == {"a": {"loss": 2, "rate": 3}, "b": {"rate": 4}}


def leaves(value: Any, *place: str) -> Iterator[tuple[str, Any]]:
    """Everything in a value that is not a list or a dictionary, by its place."""
    if isinstance(value, dict | list):
        for name, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(item, *place, str(name))
    else:
        yield ", ".join(place), value
