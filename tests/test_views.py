"""Which image is meant."""

import pytest
from pydantic import ValidationError

from juicer.episode import Role
from juicer.views import GazeCrop, StaticCrop, View


def test_views_have_one_name_exactly_if_they_show_the_same() -> None:
    view = View(camera="front", width=64)
    assert view.name == View(camera="front", width=64, height=96).name
    others = [
        View(camera="wrist", width=64),
        View(camera="front", width=65),
        View(camera="front", width=64, supersampling=2),
        View(camera="front", width=64, robot="mesh"),
        View(camera="front", width=64, crop=GazeCrop()),
        View(camera="front", width=64, crop=GazeCrop(reach_m=0.1)),
    ]
    assert len({each.name for each in (view, *others)}) == 7


def test_a_view_is_an_observation_and_a_column_of_its_size() -> None:
    view = View(camera="front", width=64, height=48)
    assert view.observed().shape == view.column.shape == (48, 64, 3)
    assert view.observed().view == view
    assert (view.observed().role, view.column.role) == (Role.OBSERVATION, Role.DERIVED)
    assert view.observed("front").name == "front"


def test_crops_that_show_nothing_are_refused() -> None:
    with pytest.raises(ValidationError, match="left must be below right"):
        StaticCrop(left=0.5, right=0.5)
    with pytest.raises(ValidationError, match="wrist camera moves"):
        View(camera="wrist", crop=GazeCrop())
