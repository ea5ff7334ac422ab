"""The figure of examples (Fig. 1 of the paper): a few images beside versions of them that a policy learns from."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from juicer.policy.backbone import FULL_BRIGHTNESS
from juicer.policy.encoders.images.config import ImagesConfig
from juicer.policy.encoders.images.network import brightness

TILE_HEIGHT, GAP, HEADER = 160, 6, 30
BACKGROUND, INK = "white", "#222222"


def augmentation_examples(
    examples: Mapping[str, NDArray[np.uint8]], config: ImagesConfig, versions: int = 5, seed: int = 0
) -> bytes:
    """A PNG with a row an image: as the policy sees it when acting, then as it may see it in training.

    Args:
        examples: Images ``(N, h, w, 3)`` by the name of their view in the configuration.
        config: How the policy looks at them.
        versions: How many of each are drawn.
        seed: Root of the draws.
    """
    rows = [row for name, images in examples.items() for row in _rows(images, config, name, versions, seed)]
    widths = [max(row[column].width for row in rows) for column in range(1 + versions)]
    sheet = Image.new("RGB", (sum(widths) + GAP * (2 + versions), HEADER + len(rows) * (TILE_HEIGHT + GAP)), BACKGROUND)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=16)
    pen.text((GAP, GAP), "when acting", INK, font)
    pen.text((widths[0] + 2 * GAP, GAP), "in training", INK, font)
    for index, row in enumerate(rows):
        left = GAP
        for tile, width in zip(row, widths, strict=True):
            sheet.paste(tile, (left, HEADER + index * (TILE_HEIGHT + GAP)))
            left += width + GAP
    content = io.BytesIO()
    sheet.save(content, "PNG", optimize=True)
    return content.getvalue()


def _rows(
    images: NDArray[np.uint8], config: ImagesConfig, name: str, versions: int, seed: int
) -> list[list[Image.Image]]:
    given = torch.from_numpy(images)[:, None]
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        varied = brightness(given.repeat_interleave(versions, dim=0), config, name, is_training=True)
    plain = [_tile(image) for image in _pixels(brightness(given, config, name, is_training=False))]
    tiles = [_tile(image) for image in _pixels(varied)]
    return [[first, *tiles[index * versions : (index + 1) * versions]] for index, first in enumerate(plain)]


def _pixels(shares: torch.Tensor) -> NDArray[np.uint8]:
    pixels: NDArray[Any] = (FULL_BRIGHTNESS * shares).round().to(torch.uint8).permute(0, 2, 3, 1).numpy()
    return pixels


def _tile(image: NDArray[np.uint8]) -> Image.Image:
    tile = Image.fromarray(np.ascontiguousarray(image))
    return tile.resize((round(tile.width * TILE_HEIGHT / tile.height), TILE_HEIGHT), Image.Resampling.BICUBIC)
