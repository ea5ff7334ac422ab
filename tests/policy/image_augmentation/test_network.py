"""What image augmentation does to colours, sharpness and place."""

from __future__ import annotations

import colorsys

import numpy as np
import pytest
import torch
from pydantic import ValidationError
from scipy.ndimage import convolve1d

from juicer.policy.image_augmentation.config import ImageAugmentation
from juicer.policy.image_augmentation.network import augmented, centre_crop, random_crop

NOTHING = {"brightness": 0.0, "contrast": 0.0, "saturation": 0.0, "hue": 0.0, "blur_kernel": 1}
GREY = torch.tensor([0.299, 0.587, 0.114])


def images_of(samples=4, steps=2, height=12, width=10, seed=0):
    """Of a middle range, so that nothing is cut off."""
    generator = torch.Generator().manual_seed(seed)
    return torch.randint(90, 150, (samples, steps, height, width, 3), dtype=torch.uint8, generator=generator)


def pixels_of(images):
    return (images / 255).movedim(-1, 2)


def varied(images, **settings):
    torch.manual_seed(1)
    return augmented(images, ImageAugmentation(**{**NOTHING, **settings}))


def grey(pixels):
    return torch.einsum("btchw,c->bthw", pixels, GREY)


def test_nothing_changes_nothing():
    torch.testing.assert_close(varied(images_of()), pixels_of(images_of()), atol=1e-5, rtol=0)


def test_brightness_is_a_factor_of_each_sample_within_its_bounds():
    factors = varied(images_of(samples=200), brightness=0.3) / pixels_of(images_of(samples=200))
    of_sample = factors.flatten(1).mean(dim=1)
    assert torch.allclose(factors, of_sample.view(-1, 1, 1, 1, 1).expand_as(factors), atol=1e-4)
    assert 0.7 <= of_sample.min() < 0.75
    assert 1.25 < of_sample.max() <= 1.3


def test_contrast_keeps_the_mean_grey_and_scales_what_differs_from_it():
    images = images_of()
    result = varied(images, contrast=0.3)
    mean = grey(pixels_of(images)).flatten(1).mean(dim=1).view(-1, 1, 1, 1, 1)
    torch.testing.assert_close(grey(result).flatten(1).mean(dim=1), mean.flatten(), atol=1e-5, rtol=0)
    factors = (result - mean) / (pixels_of(images) - mean)
    assert factors.flatten(1).quantile(0.9, dim=1).allclose(factors.flatten(1).quantile(0.1, dim=1), atol=1e-2)


def test_saturation_keeps_every_grey_and_scales_the_distance_to_it():
    images = images_of()
    before, after = pixels_of(images), varied(images, saturation=0.3)
    torch.testing.assert_close(grey(after), grey(before), atol=2e-3, rtol=0)
    distance = (after - grey(after).unsqueeze(2)).flatten(1).norm(dim=1) / (before - grey(before).unsqueeze(2)).flatten(
        1
    ).norm(dim=1)
    assert 0.7 <= distance.min() < distance.max() <= 1.3


def test_hue_keeps_every_grey_and_turns_colours_by_at_most_what_was_said():
    images = images_of(samples=200, steps=1, height=1, width=1)
    images[:] = torch.tensor([150, 100, 100], dtype=torch.uint8)
    after = varied(images, hue=0.1)[:, 0, :, 0, 0]
    torch.testing.assert_close(after @ GREY, (pixels_of(images)[:, 0, :, 0, 0]) @ GREY, atol=2e-3, rtol=0)
    turns = np.array([(colorsys.rgb_to_hsv(*colour)[0] + 0.5) % 1 - 0.5 for colour in after.tolist()])
    assert -0.15 < turns.min() < -0.05
    assert 0.05 < turns.max() < 0.15


def test_grey_images_stay_grey():
    images = images_of()[..., :1].expand(-1, -1, -1, -1, 3)
    result = varied(images, brightness=0.3, contrast=0.3, saturation=0.3, hue=0.5)
    assert float((result.amax(dim=2) - result.amin(dim=2)).max()) < 5e-3


def test_blur_is_that_of_a_gaussian_reflected_at_the_edges():
    images = images_of()
    result = varied(images, blur_kernel=5, blur_sigma=(1.5, 1.5))
    profile = np.exp(-0.5 * (np.arange(-2, 3) / 1.5) ** 2)
    expected = pixels_of(images).double().numpy()
    for axis in (-2, -1):
        expected = convolve1d(expected, profile / profile.sum(), axis=axis, mode="mirror")
    np.testing.assert_allclose(result.numpy(), expected, atol=1e-5)


def test_every_sample_has_a_draw_of_its_own_and_all_its_steps_share_it():
    one = images_of(samples=1, steps=1)
    result = varied(one.expand(6, 3, -1, -1, -1), brightness=0.3, hue=0.3, blur_kernel=5)
    assert torch.allclose(result[:, :1].expand_as(result), result, atol=1e-6)
    assert all(not torch.equal(result[0], result[index]) for index in range(1, 6))


def test_the_result_is_within_full_brightness_also_under_autocast():
    images = torch.randint(0, 256, (8, 1, 9, 9, 3), dtype=torch.uint8)
    config = ImageAugmentation()
    torch.manual_seed(0)
    plain = augmented(images, config)
    with torch.autocast("cpu", torch.bfloat16):
        torch.manual_seed(0)
        assert torch.equal(augmented(images, config), plain)
    assert 0 <= plain.min() < plain.max() <= 1


def test_a_random_crop_is_a_part_of_its_sample_and_reaches_every_place():
    rows, columns = torch.meshgrid(torch.arange(6), torch.arange(8), indexing="ij")
    image = torch.stack([rows, columns, rows * columns], dim=-1).to(torch.uint8)
    torch.manual_seed(0)
    crops = random_crop(image.expand(300, 2, -1, -1, -1), (4, 7))
    assert crops.shape == (300, 2, 4, 7, 3)
    assert torch.equal(crops[:, 0], crops[:, 1])
    corners = {tuple(corner) for corner in crops[:, 0, 0, 0, :2].tolist()}
    assert corners == {(row, column) for row in range(3) for column in range(2)}
    for crop in crops[:20, 0]:
        top, left = crop[0, 0, :2].tolist()
        assert torch.equal(crop, image[top : top + 4, left : left + 7])


def test_the_centre_crop_is_the_middle():
    images = images_of(height=10, width=13)
    assert torch.equal(centre_crop(images, (6, 7)), images[:, :, 2:8, 3:10])


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [({"blur_kernel": 4}, "blur_kernel must be odd, got 4"), ({"blur_sigma": (2.0, 1.0)}, "blur_sigma must rise")],
)
def test_an_impossible_blur_is_refused(settings, sentence):
    with pytest.raises(ValidationError, match=sentence):
        ImageAugmentation(**settings)
