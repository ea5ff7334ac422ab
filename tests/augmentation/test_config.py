from __future__ import annotations

import pytest
from pydantic import ValidationError

from juicer.augmentation.config import FAR, AugmentationConfig, DepartureConfig


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
