import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from juicer.policy.normalizer import Normalizer


def fitted(values):
    normalizer = Normalizer((values.shape[1],))
    normalizer.fit(values)
    return normalizer


def test_training_data_fill_the_range_from_minus_one_to_one():
    values = torch.randn(100, 3) * torch.tensor([0.1, 1.0, 10.0]) + 5
    scaled = fitted(values).normalize(values)
    np.testing.assert_allclose(scaled.amin(0), [-1] * 3, atol=1e-5)
    np.testing.assert_allclose(scaled.amax(0), [1] * 3, atol=1e-5)


def test_a_constant_dimension_becomes_zero_and_comes_back():
    values = torch.cat([torch.randn(10, 1), torch.full((10, 1), 0.7)], dim=1)
    normalizer = fitted(values)
    assert torch.all(normalizer.normalize(values)[:, 1] == 0)
    np.testing.assert_allclose(normalizer.denormalize(torch.zeros(1, 2))[0, 1], 0.7)


@given(st.lists(st.floats(-1e3, 1e3, width=32), min_size=2, max_size=20))
def test_denormalize_undoes_normalize(numbers):
    values = torch.tensor(numbers)[:, None]
    normalizer = fitted(values)
    back = normalizer.denormalize(normalizer.normalize(values))
    np.testing.assert_allclose(back, values, rtol=1e-5, atol=1e-3)


def test_limits_travel_with_the_weights():
    normalizer, other = fitted(torch.randn(10, 4)), Normalizer((4,))
    other.load_state_dict(normalizer.state_dict())
    values = torch.randn(5, 4)
    assert torch.equal(normalizer.normalize(values), other.normalize(values))


def test_limits_may_differ_for_every_step_of_a_chunk():
    chunks = torch.randn(50, 4, 2) * torch.tensor([1.0, 2.0, 3.0, 4.0])[:, None]
    normalizer = Normalizer((4, 2))
    normalizer.fit(chunks)
    np.testing.assert_allclose(normalizer.normalize(chunks).amax(0), np.ones((4, 2)), atol=1e-5)


def test_shared_limits_span_all_steps_of_a_chunk():
    chunks = torch.randn(50, 4, 2) * torch.tensor([1.0, 2.0, 3.0, 4.0])[:, None]
    normalizer = Normalizer((2,))
    normalizer.fit(chunks)
    np.testing.assert_allclose(normalizer.normalize(chunks).amax((0, 1)), [1, 1], atol=1e-5)
