"""Sample images between their texels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def sample(images: NDArray[Any], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sample ``images`` [..., H, W] bilinearly at positions [n] in texels (0: first texel's centre); NaN outside."""
    values, inside = sampled(images, x, y)
    return np.where(inside, values, np.nan)


def sampled(
    images: NDArray[Any], x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return what ``sample`` returns, but any numbers outside, and the mask of the positions inside."""
    height, width = images.shape[-2:]
    inside = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)  # false for NaN
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    left, top = np.minimum(x.astype(np.int64), max(width - 2, 0)), np.minimum(y.astype(np.int64), max(height - 2, 0))
    fx, fy = x - left, y - top
    # Flat indices, computed once for all images and taps, because the check spends most of its time here.
    flat, place = images.reshape(*images.shape[:-2], -1), top * width + left
    right, down = int(width > 1), width * int(height > 1)
    upper = flat.take(place, axis=-1) * (1 - fx) + flat.take(place + right, axis=-1) * fx
    lower = flat.take(place + down, axis=-1) * (1 - fx) + flat.take(place + (down + right), axis=-1) * fx
    return upper * (1 - fy) + lower * fy, inside
