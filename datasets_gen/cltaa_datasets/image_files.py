"""Image files as texels, through Pillow."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image, UnidentifiedImageError

from cltaa_datasets.scene import Texels


def opened(content: bytes) -> Image.Image:
    """Decode an image file; raises ValueError with the reason for one that cannot be read."""
    try:
        image: Image.Image = Image.open(io.BytesIO(content))
        image.load()
    except UnidentifiedImageError as error:
        raise ValueError("of no known format") from error  # Pillow would name an address in memory
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(str(error)) from error
    return image


def texels(image: Image.Image) -> Texels:
    """Return RGBA texels [H, W, 4]."""
    if image.mode.startswith("I"):  # grey of 16 bits, which Pillow would clip at 255
        image = Image.fromarray((np.asarray(image) >> 8).astype(np.uint8))
    return np.asarray(image.convert("RGBA"), np.uint8)
