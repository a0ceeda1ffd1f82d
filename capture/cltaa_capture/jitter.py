"""Sample positions inside a pixel, in pixels from its centre: x right, y down, in [-0.5, 0.5)."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from math import gcd, isqrt

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import InternalError, UsageError

Offsets = NDArray[np.float64]  # [N, 2]

# The plastic number, root of x^3 = x + 1: Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences" (2018).
PLASTIC = 1.3247179572447460

USUAL = "lattice:64"  # measured: docs/decisions/09
LONGEST_PERIOD = 1 << 16  # samples; takes half a second to make, and is far beyond the precision of a float32 sum
FADING = 0.95  # factor on an earlier sample's weight for each later one, in the lattice order; docs/decisions/09
LONGEST_LATTICE = 1 << 10  # samples; ordering takes memory proportional to their square, 25 MB here


def radical_inverse(index: int, base: int) -> float:
    """Return the radical inverse: the digits of ``index`` mirrored about the point (van der Corput)."""
    value, digit = 0.0, 1.0
    while index > 0:
        digit /= base
        value += digit * (index % base)
        index //= base
    return value


def halton(count: int) -> Offsets:
    """Return Halton points in bases 2 and 3, from index 1, as in games."""
    return np.array([[radical_inverse(i, 2), radical_inverse(i, 3)] for i in range(1, count + 1)])


def r2(count: int) -> Offsets:
    """Return Roberts' R2 sequence, the two-dimensional counterpart of the golden-ratio sequence."""
    steps = np.array([1.0 / PLASTIC, 1.0 / PLASTIC**2])
    return np.asarray((np.arange(1, count + 1)[:, None] * steps) % 1.0)


def grid(count: int) -> Offsets:
    """Return the centres of a square grid, row by row; raises UsageError if ``count`` is no square."""
    side = isqrt(count)
    if side * side != count:
        raise UsageError(f"grid:{count} is not a square number of samples", cure=f"use grid:{(side + 1) ** 2}")
    down, across = np.divmod(np.arange(count), side)
    return (np.stack([across, down], 1) + 0.5) / side


def hammersley(count: int) -> Offsets:
    """Return Hammersley points in base 2: one point in each of N columns; for a power of two a (0, m, 2)-net.

    Each division of the pixel into N equal dyadic boxes then has one point per box (Niederreiter 1992, ch. 4), so that
    an edge along any of those directions is integrated with an error of 1/N; a grid's is 1/sqrt(N).
    """
    return np.array([[(i + 0.5) / count, radical_inverse(i, 2)] for i in range(count)])


@cache
def lattice(count: int) -> Offsets:
    """Return the rank-1 lattice (i, z i) / N, ordered so that each frame adds the most to those before (``herded``).

    z maximises the shortest vector (Niederreiter 1992, ch. 5) and is coprime to N, so that each of N columns and rows
    has one point. Raises UsageError beyond LONGEST_LATTICE points.
    """
    if count > LONGEST_LATTICE:
        raise UsageError(f"lattice:{count} is too long to put in order", cure=f"use lattice:{LONGEST_LATTICE} at most")
    index = np.arange(count)
    factors = (z for z in range(1, count // 2 + 1) if gcd(z, count) == 1)
    factor = max(factors, key=lambda z: (_shortest_vector(index, z), z), default=1)
    return herded((np.stack([index, index * factor % count], 1) + 0.5) / count)


def _shortest_vector(index: NDArray[np.int64], factor: int) -> int:
    """Return the squared length of the shortest vector of the lattice (i, z i) on the torus of N x N squares."""
    count = len(index)
    across, down = ((v + count // 2) % count - count // 2 for v in (index[1:], index[1:] * factor))
    return int((across**2 + down**2).min(initial=2 * count**2))


def herded(points: Offsets) -> Offsets:
    """Order points [N, 2] so that each next point makes the set so far most like the whole set.

    Kernel herding (Chen, Welling, Smola, "Super-Samples from Kernel Herding", 2010) for the covariance exp(-2 d) of
    positions d pixels apart, about that of a picture full of edges. Weights of earlier points fade, so that the latest
    points are also even by themselves, because motion leaves only those. The order begins in the middle, and its steps
    follow no pattern that a steady drift could cancel.
    """
    covariance = np.exp(-2.0 * np.hypot(*(points[:, None] - points).transpose(2, 0, 1)))
    to_all, to_taken, taken = covariance.mean(axis=0), np.zeros(len(points)), 1.0
    order: list[int] = []
    for _ in points:
        # Rounded, so that every machine takes the first of mirrored points, which are equally good.
        gain = np.round(to_all - to_taken / taken, 12)
        gain[order] = -np.inf
        order.append(int(gain.argmax()))
        to_taken = FADING * (to_taken + covariance[order[-1]])
        taken = FADING * taken + 1.0
    return points[order]


PATTERNS: dict[str, Callable[[int], Offsets]] = {
    "halton": halton,
    "r2": r2,
    "lattice": lattice,
    "grid": grid,
    "hammersley": hammersley,
}


# Uncentred sequences of three published resolves, for the presets of those names.
PUBLISHED: dict[str, Offsets] = {
    # (h - 1/2) / size in NDC, which spans 2, is half a pixel; y up
    "vireo": (halton(16) - 0.5) * (0.5, -0.5),
    # the image moves by (h - 1/2) px, y up, and the sample opposite to it
    "babylon": (halton(8) - 0.5) * (-1.0, 1.0),
    # the index is incremented before its first use
    "simvx": np.roll(halton(8), -1, axis=0) - 0.5,
}


def centred(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotate points [N] of the unit circle [0, 1) so that as offsets in [-0.5, 0.5) their mean is zero.

    A remaining mean would shift the picture permanently. Subtracting it may push k points over the edge, where they
    wrap around and change the mean by k/N; so the wanted rotation is -mean + k/N for some k. One exists: the mean rises
    continuously with the rotation, falls only by jumps of 1/N, and averages zero over a full rotation.
    """
    offsets, count = points - 0.5, len(points)
    for wrapped in sorted(range(-count, count + 1), key=abs):
        turned = offsets + (wrapped / count - offsets.mean())
        turned -= np.floor(turned + 0.5)
        if abs(turned.mean()) < 0.5 / count:
            return np.asarray(turned)
    raise InternalError(f"no turn centres a jitter of {count} points")


def jitter_sequence(text: str) -> Offsets:
    """Parse ``none``, ``PATTERN:N`` or a published name into offsets [N, 2]; raises UsageError for anything else.

    Patterns are centred; published sequences stay as published.
    """
    if text == "none":
        return np.zeros((1, 2))
    if text in PUBLISHED:
        return PUBLISHED[text].copy()
    name, _, period = text.partition(":")
    if name not in PATTERNS or not re.fullmatch("[1-9][0-9]{0,5}", period) or int(period) > LONGEST_PERIOD:
        known = ", ".join([*(f"{pattern}:N" for pattern in PATTERNS), *PUBLISHED])
        cure = f"use none or one of {known}, N from 1 to {LONGEST_PERIOD}"
        raise UsageError(f"no such jitter: {text}", cure=cure)
    points = PATTERNS[name](int(period))
    return np.stack([centred(points[:, 0]), centred(points[:, 1])], axis=1)
