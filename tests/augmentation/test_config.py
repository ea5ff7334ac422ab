from __future__ import annotations

import pytest
from pydantic import ValidationError

from juicer.augmentation.config import FAR, PAPER_AUGMENTATION, AugmentationConfig, DepartureConfig


def test_a_range_must_not_run_backwards():
    with pytest.raises(ValidationError, match="distance_m"):
        DepartureConfig.model_validate(FAR.model_dump() | {"distance_m": (0.5, 0.2)})


def test_a_range_must_not_be_negative():
    with pytest.raises(ValidationError, match="lift_m"):
        DepartureConfig.model_validate(FAR.model_dump() | {"lift_m": (-0.1, 0.2)})


def test_there_must_be_a_kind_of_departure():
    with pytest.raises(ValidationError, match="departures"):
        AugmentationConfig(departures={})


def test_unknown_keys_are_refused():
    with pytest.raises(ValidationError, match="num_snipets"):
        AugmentationConfig.model_validate({"num_snipets": 3})


def test_the_papers_numbers_are_the_papers():
    (departure,) = PAPER_AUGMENTATION.departures.values()
    assert departure.distance_m == (0.2, 0.5)
    assert departure.polar_deg == (5.0, 80.0)
    assert departure.rotation_deg == 180.0
    for tolerance in (PAPER_AUGMENTATION.tolerance, PAPER_AUGMENTATION.end_tolerance):
        assert (tolerance.position_m, tolerance.rotation_deg, tolerance.gripper_width_m) == (0.017, 20.0, 0.005)
    assert PAPER_AUGMENTATION.steps_after_gripper_change == 30
