"""Pictures as a signal to register: compressed luminance, band-passed, so that light may change and edges remain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cltaa.frames import Image
from cltaa.pictures.display import LUMA

Vector = NDArray[np.float64]
Points = tuple[NDArray[np.int64], NDArray[np.int64]]  # columns and rows

FINE_PX = 0.6  # standard deviation of the blur that tames the aliasing of one sample a pixel
COARSE_PX = 4.0  # and of the one that is subtracted: slower changes are light, not place
MOST_POINTS = 60_000  # points looked at in a frame; more only cost time


def register_signal(colour: Image) -> NDArray[np.float32]:
    """The band of ``colour`` [H, W, 3] that carries position: [H, W] float32, zero mean locally."""
    squeezed = squeezed_light(colour)
    return np.subtract(blur(squeezed, FINE_PX), blur(squeezed, COARSE_PX), dtype=np.float32)


def squeezed_light(colour: Image) -> NDArray[np.float32]:
    """Luminance of ``colour`` [H, W, 3] squeezed into 0 to 1, [H, W] float32."""
    finite = np.nan_to_num(colour.astype(np.float32), nan=0.0, posinf=65504.0, neginf=0.0)
    light: NDArray[np.float32] = np.maximum(finite @ LUMA, np.float32(0))
    # Compressed by its own middle: bright spots do not outweigh the rest, and exposure cancels.
    middle = float(np.median(light[light > 0])) if (light > 0).any() else 1.0
    squeezed: NDArray[np.float32] = light / (light + np.float32(middle))
    return squeezed


def blur(image: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """Gaussian blur of [H, W] with repeated edges."""
    radius = max(1, round(3 * sigma))
    offsets = np.arange(-radius, radius + 1)
    weights = np.exp(-0.5 * (offsets / sigma) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    for axis in (0, 1):
        size = image.shape[axis]
        padded = np.pad(image, [(radius, radius) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
        image = sum(
            (w * np.take(padded, range(k, k + size), axis=axis) for k, w in enumerate(weights)), np.zeros_like(image)
        )
    return image


def grid_points(height: int, width: int) -> Points:
    """Columns and rows of at most MOST_POINTS pixels in a regular grid."""
    step = int(np.ceil(np.sqrt(max(1.0, height * width / MOST_POINTS))))
    y, x = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    return x.ravel(), y.ravel()


def sample(images: NDArray[np.float32], x: Vector, y: Vector) -> Vector:
    """``images`` [..., H, W] at positions [n] in texels (0 is the first texel's centre), bilinear; NaN outside."""
    height, width = images.shape[-2:]
    inside = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)  # false for NaN
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    left, top = np.minimum(x.astype(np.int64), max(width - 2, 0)), np.minimum(y.astype(np.int64), max(height - 2, 0))
    fx, fy = x - left, y - top
    # By place in the flat image, worked out once for all images and taps: most of the detector's time is spent here.
    flat, place = images.reshape(*images.shape[:-2], -1), top * width + left
    right, down = int(width > 1), width * int(height > 1)
    upper = flat.take(place, axis=-1) * (1 - fx) + flat.take(place + right, axis=-1) * fx
    lower = flat.take(place + down, axis=-1) * (1 - fx) + flat.take(place + (down + right), axis=-1) * fx
    return np.where(inside, upper * (1 - fy) + lower * fy, np.nan)
