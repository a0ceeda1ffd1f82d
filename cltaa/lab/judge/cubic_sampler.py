"""Cubic B-spline interpolation of many images at the same places: what ``scipy.ndimage.map_coordinates`` gives, faster.

Interpolating splines as in Unser, "Splines: a perfect fit for signal and image processing" (1999). The sixteen weights
a place are worked out once and are a row of a sparse matrix; an image then costs its spline coefficients and a product.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import import_extra
from cltaa.lab.judge.detail import import_ndimage

Array = NDArray[np.float64]

MARGIN = 12  # texels repeated around an image, as scipy's own: coefficients feel an edge by 0.27 to this power, 1e-7
REACH = 8  # texels outside the image; beyond, all is edge


class CubicSampler:
    """Samples images [H, W, C] of one size at ``n`` fixed places: ``x``, ``y`` in texels, centres at whole numbers.

    Around the image its edge is repeated. Raises UsageError without scipy.
    """

    def __init__(self, height: int, width: int, x: Array, y: Array) -> None:
        sparse = import_extra("scipy.sparse", package="scipy", extra="metrics", purpose="judging a sequence in time")
        row, down = _taps(np.clip(y, -REACH, height - 1 + REACH))
        column, across = _taps(np.clip(x, -REACH, width - 1 + REACH))
        stride = width + 2 * MARGIN
        places = row[:, :, None] * stride + column[:, None, :]
        weights = down[:, :, None] * across[:, None, :]
        starts = np.arange(0, weights.size + 1, 16, dtype=np.int32)
        shape = (len(x), (height + 2 * MARGIN) * stride)
        self._matrix: Any = sparse.csr_matrix((weights.ravel(), places.ravel(), starts), shape=shape)

    def __call__(self, image: Array) -> Array:
        """The values of ``image`` [H, W, C] at the places, [n, C]."""
        return np.stack([self._matrix @ _coefficients(plane) for plane in np.moveaxis(image, -1, 0)], axis=-1)


def _coefficients(plane: Array) -> Array:
    """Spline coefficients of a plane [H, W] and of a margin around it, flat."""
    padded = np.pad(plane, MARGIN, mode="edge")
    flat: Array = import_ndimage().spline_filter(padded, 3, mode="nearest").ravel()
    return flat


def _taps(place: Array) -> tuple[NDArray[np.int32], Array]:
    """Along one axis: the four coefficients that count at each place, counted in the margin too, and their weights."""
    whole = np.floor(place)
    t = place - whole
    first = whole.astype(np.int32)[:, None] + np.int32(MARGIN - 1)
    weights = np.stack([(1 - t) ** 3, 4 - 6 * t**2 + 3 * t**3, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3], axis=-1) / 6
    taps: NDArray[np.int32] = first + np.arange(4, dtype=np.int32)[None, :]
    return taps, weights
