"""Resolved images as channels, and in half precision: how many of their pixels reach the largest half."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.constants import value
from cltaa.exr.channels import Pixels
from cltaa.frames import Image

INFINITE, BELOW_ZERO = 0x7C00, 0x8000  # bits of an infinite half, and of the sign


def image_channels(image: NDArray[Any]) -> dict[str, Pixels]:
    """A resolved image [H, W, 3 or 4] as EXR channels R G B [A]."""
    return {name: image[..., channel] for channel, name in enumerate("RGBA"[: image.shape[-1]])}


def limit_halves(image: NDArray[np.float16]) -> int:
    """Make the largest half of each infinite one of [H, W, 3 or 4], in place; returns the pixels that have such.

    Those are the pixels that were cut: a result in halves is infinite from the largest half on.
    """
    signed, bits = image.view(np.int16), image.view(np.uint16)
    if signed.max() < INFINITE and bits.max() < INFINITE | BELOW_ZERO:  # as whole numbers the greatest of either sign
        return 0
    infinite = np.isinf(image)
    bits -= infinite  # the half before it
    return int(infinite.any(axis=-1).sum())


def saturated_pixels(image: Image) -> int:
    """Count the pixels of floats [H, W, 3 or 4] that halves cut: with a channel at the largest half, 65504, or more."""
    largest = value("HALF_LIMIT")
    if -largest < float(image.min()) and float(image.max()) < largest:
        return 0
    return int((np.abs(image) >= largest).any(axis=-1).sum())
