"""Fine detail of an image against the truth's: how much of it is lost, and how much was never there."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import import_extra

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TILE = 32  # pixels a side of the tiles within which a blur counts as one and the same
# Binomial filters of 3 and 5 taps; fine detail is what the wide one takes away.
NARROW, WIDE = np.array([1, 2, 1]) / 4, np.array([1, 4, 6, 4, 1]) / 16
SLOPE = np.array([-0.5, 0, 0.5])
REACH = 2  # pixels, of the wide filter
MARGIN = 2 * REACH  # of two such filters one after another
LEAST_ROWS = 10  # judged values for each filter of the family; with fewer the family explains anything
RANK = 1e-10  # eigenvalues of a tile's Gram matrix below this share of the largest carry rounding alone


class Detail(NamedTuple):
    """Sums over judged pixels and channels."""

    product: float  # of the test's fine detail and the truth's
    square: float  # of the truth's
    false_square: float  # of what no filter of the truth explains of the test's
    false_count: int  # how many values that is a sum of


def import_ndimage() -> Any:
    """Import scipy's filters; raises UsageError that says what to install."""
    return import_extra("scipy.ndimage", package="scipy", extra="metrics", purpose="judging a sequence in time")


def blurred(image: Array) -> Array:
    """The wide filter along both axes of [H, W, ...]; edges repeat."""
    for axis in (0, 1):
        margin = [(0, 0)] * image.ndim
        margin[axis] = (REACH, REACH)
        # Sums of whole slices take half the time of scipy's filter.
        padded = np.moveaxis(np.pad(image, margin, mode="edge"), axis, 0)
        length = image.shape[axis]
        taps = (weight * padded[at : at + length] for at, weight in enumerate(WIDE))
        image = np.moveaxis(sum(taps, start=np.zeros(())), 0, axis)
    return image


def judge_detail(truth: Array, tests: list[Array], judged: Mask) -> list[Detail]:
    """Fine detail of each test against that of the truth, display values [H, W, 3], where ``judged`` [H, W].

    The margin of the image that the filters reach out of is not judged. In bands of tiles, so that the family of
    filters is in memory for one band only.
    """
    inside = np.zeros_like(judged)
    inside[MARGIN:-MARGIN, MARGIN:-MARGIN] = judged[MARGIN:-MARGIN, MARGIN:-MARGIN]
    judged = inside
    truth_fine = truth - blurred(truth)
    tests_fine = [test - blurred(test) for test in tests]
    judged_fine = np.where(judged[..., None], truth_fine, 0.0)
    square = float((judged_fine**2).sum())
    false = np.zeros((len(tests), 2))
    for top in range(0, truth.shape[0], TILE):
        band = np.s_[top : top + TILE]
        family = _family(truth, top)
        false += _unexplained(family, np.stack([fine[band] for fine in tests_fine]), judged[band])
    return [
        Detail(float((fine * judged_fine).sum()), square, float(rest), int(count))
        for fine, (rest, count) in zip(tests_fine, false, strict=True)
    ]


def _family(truth: Array, top: int) -> Array:
    """The truth's fine detail in one band after 3 widths of blur a direction and after shifts, [rows, W, 3, 11]."""
    ndimage = import_ndimage()
    rows = np.arange(top - MARGIN, min(top + TILE, truth.shape[0]) + MARGIN)
    slab = truth[np.clip(rows, 0, truth.shape[0] - 1)]

    def along(image: Array, kernel: Array, axis: int) -> Array:
        filtered: Array = ndimage.correlate1d(image, kernel, axis, mode="nearest")
        return filtered

    across = [slab, along(slab, NARROW, 1), along(slab, WIDE, 1)]
    both = [filtered for image in across for filtered in (image, along(image, NARROW, 0), along(image, WIDE, 0))]
    shifts = [along(slab, SLOPE, axis) for axis in (0, 1)]
    return np.stack([(image - blurred(image))[MARGIN:-MARGIN] for image in (*both, *shifts)], axis=-1)


def _unexplained(family: Array, tests: Array, judged: Mask) -> Array:
    """Sum of squares and count of what least squares over each tile leave of each test, [tests, 2].

    ``family`` [rows, W, 3, F], ``tests`` [tests, rows, W, 3]. By the normal equations, which is all that sums need:
    the rest is s.s - (F s)' G^-1 (F s) with the Gram matrix G of the tile.
    """
    result = np.zeros((len(tests), 2))
    for left in range(0, judged.shape[1], TILE):
        seen = judged[:, left : left + TILE]
        filters = family[:, left : left + TILE][seen].reshape(-1, family.shape[-1])
        if len(filters) < LEAST_ROWS * family.shape[-1]:
            continue
        inverse = np.linalg.pinv(filters.T @ filters, rcond=RANK, hermitian=True)
        for sums, test in zip(result, tests, strict=True):  # one at a time: the same to the last bit beside any others
            values = test[:, left : left + TILE][seen].ravel()
            explained = values @ filters
            sums += max(float(values @ values - explained @ inverse @ explained), 0.0), len(filters)
    return result
