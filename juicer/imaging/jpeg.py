"""Images as JPEG: for pages and recordings that people look at, never for what a policy learns from."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

QUALITY = 85


def encode_jpeg(pixels: NDArray[np.uint8]) -> bytes:
    """File of an image ``(height, width, 3)``."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=QUALITY)
    return buffer.getvalue()
