"""Images in half precision: their channels, and how many of their pixels reach the largest half."""

from __future__ import annotations

import numpy as np

from cltaa.allocator import empty_image
from cltaa.constants import value
from cltaa.exr_channels import Pixels
from cltaa.frames import Image


def image_channels(image: Image, *, half: bool = False, within: bool = False) -> dict[str, Pixels]:
    """A resolved image [H, W, 3 or 4] as EXR channels R G B [A], in half (saturated to its range) or float32.

    ``within`` says that none of its ``saturated_pixels`` is left, so that none need be limited.
    """
    planes: dict[str, Pixels] = {name: image[..., channel] for channel, name in enumerate("RGBA"[: image.shape[-1]])}
    if not half:
        return planes
    if within:
        return {name: plane.astype(np.float16) for name, plane in planes.items()}
    largest, limited = value("HALF_LIMIT"), empty_image(image.shape[:2])
    return {name: np.clip(plane, -largest, largest, out=limited).astype(np.float16) for name, plane in planes.items()}


def saturated_pixels(image: Image) -> int:
    """Count the pixels of [H, W, 3 or 4] that halves cut: with a channel at 65504, the largest half, or beyond."""
    largest = value("HALF_LIMIT")
    if -largest < float(image.min()) and float(image.max()) < largest:
        return 0
    return int((np.abs(image) >= largest).any(axis=-1).sum())
