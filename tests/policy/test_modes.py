import numpy as np
import pytest

from juicer.policy.modes import BLOCK, densest


def two_modes(number, share, seed=0, size=(8, 10)):
    """Chunks near one of two points, most of them near the first; entries of a chunk move together."""
    rng = np.random.default_rng(seed)
    near_first = rng.random(number) < share
    centre = np.where(near_first, 0.5, -0.5)[:, None, None]
    return centre + 0.05 * rng.normal(size=(number, 1, 1)) + 0.01 * rng.normal(size=(number, *size)), near_first


@pytest.mark.parametrize("number", [16, 256, BLOCK + 88])
def test_the_densest_sample_lies_in_the_mode_that_most_are_near_and_in_its_middle(number):
    samples, near_first = two_modes(number, share=0.7)
    chosen = densest(samples)
    assert near_first[chosen]
    off = np.abs(samples[near_first].mean(axis=(1, 2)) - samples[near_first].mean())
    assert abs(samples[chosen].mean() - samples[near_first].mean()) <= np.quantile(off, 0.6)


def test_in_as_many_dimensions_as_a_chunk_has_numbers_neighbours_still_count():
    # With a width for 320 dimensions every kernel but its own vanishes, and the first sample would win.
    samples, _ = two_modes(64, share=0.8, size=(32, 10))
    samples[0] = -3.0
    assert densest(samples) != 0


def test_of_samples_that_are_all_alike_the_first_is_taken():
    assert densest(np.ones((5, 8, 10))) == 0


def test_the_choice_depends_neither_on_a_shift_nor_on_the_scale():
    samples, _ = two_modes(40, share=0.6)
    assert densest(samples) == densest(3 * samples + 7)
