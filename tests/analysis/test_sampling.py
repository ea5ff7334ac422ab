import numpy as np
import pytest

from juicer.analysis.sampling import changes, distances
from juicer.geometry import axis_rotation, matrix_to_rot6d
from juicer.storage.analyses import DIMENSIONS


def actions(positions, rotation=None, gripper=1.0):
    rot6d = matrix_to_rot6d(np.eye(3) if rotation is None else rotation)
    return np.array([[*position, *rot6d, gripper] for position in positions])


def test_changes_are_millimetres_and_degrees_from_the_present_pose():
    here = np.concatenate([[0.5, 0.0, 0.1], matrix_to_rot6d(axis_rotation("z", 0.3)), np.zeros(7)])
    turned = axis_rotation("x", np.deg2rad(10)) @ axis_rotation("z", 0.3)
    (change,) = changes(actions([[0.51, 0.0, 0.098]], turned, gripper=-1.0), here)
    np.testing.assert_allclose(change, [10, 0, -2, 10, 0, 0, -1], atol=1e-9)


def test_a_shift_of_one_dimension_is_its_distance_and_no_other_is_apart():
    rng = np.random.default_rng(0)
    reference = rng.normal(size=(500, 7))
    shifted = reference + np.array([0, 0, 2.0, 0, 0, 0, 0])
    apart = distances(shifted, reference, np.random.default_rng(1))
    assert apart["z"] == pytest.approx(2.0)
    assert all(apart[name] == 0 for name in DIMENSIONS if name != "z")
    assert 0 < apart["sliced"] < 2.0 / reference[:, 2].std()
    assert distances(reference, reference, np.random.default_rng(1))["sliced"] == 0


def test_what_hardly_spreads_is_not_blown_up_to_a_large_distance():
    reference = np.zeros((10, 7))
    assert distances(reference + 1e-4, reference, np.random.default_rng(0))["sliced"] < 0.05


def test_sets_of_different_size_are_refused():
    with pytest.raises(ValueError, match="as many"):
        distances(np.zeros((3, 7)), np.zeros((4, 7)), np.random.default_rng(0))
