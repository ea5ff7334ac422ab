import io

import numpy as np
from PIL import Image

from juicer.policy.encoders.images.config import ImagesConfig
from juicer.policy.image_augmentation.config import ImageAugmentation
from juicer.reporting.augmentation_examples import GAP, HEADER, TILE_HEIGHT, augmentation_examples
from juicer.views import View

VIEWS = {"front": View(camera="front", width=280, height=240), "wrist": View(camera="wrist", width=64, height=64)}
CROPS = {"front": {"width": 224, "height": 224}}


def test_every_image_has_a_row_which_begins_with_what_is_seen_when_acting():
    config = ImagesConfig(views=VIEWS, crops=CROPS, augmentation=ImageAugmentation())
    rng = np.random.default_rng(0)
    examples = {
        name: rng.integers(0, 256, size=(2, view.height, view.width, 3), dtype=np.uint8) for name, view in VIEWS.items()
    }
    png = augmentation_examples(examples, config, versions=3)
    with Image.open(io.BytesIO(png)) as sheet:
        assert sheet.size == (4 * TILE_HEIGHT + 5 * GAP, HEADER + 4 * (TILE_HEIGHT + GAP))
        pixels = np.asarray(sheet)
    expected = Image.fromarray(examples["wrist"][0]).resize((TILE_HEIGHT, TILE_HEIGHT), Image.Resampling.BICUBIC)
    top = HEADER + 2 * (TILE_HEIGHT + GAP)
    np.testing.assert_array_equal(pixels[top : top + TILE_HEIGHT, GAP : GAP + TILE_HEIGHT], np.asarray(expected))
    assert augmentation_examples(examples, config, versions=3) == png
    assert augmentation_examples(examples, config, versions=3, seed=1) != png
