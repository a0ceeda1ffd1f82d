"""Where one picture lies on another: robust least squares of the shift that a motion field leaves over.

The method is that of Lucas and Kanade (1981, An iterative image registration technique), over all points at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.checking.signal import Vector, sample

ITERATIONS = 8
FARTHEST_PX = 2.0  # a left-over shift beyond this is no jitter
LEAST_POINTS = 60  # fewer decide nothing


class Picture(NamedTuple):
    """A signal [H, W] and its gradient [2, H, W], by x and by y."""

    signal: NDArray[np.float32]
    gradient: NDArray[np.float32]

    @classmethod
    def of(cls, signal: NDArray[np.float32]) -> Picture:
        """Differentiate ``signal`` by central differences."""
        return cls(signal, np.stack([_slope(signal, axis) for axis in (1, 0)]))


def _slope(signal: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """Central differences along ``axis``; 0 where there is one pixel and nothing to differ from."""
    return np.asarray(np.gradient(signal, axis=axis), np.float32) if signal.shape[axis] > 1 else np.zeros_like(signal)


class Fit(NamedTuple):
    """The shift [2] of the earlier picture, the information about it [2, 2] (inverse covariance), and the residual."""

    shift: Vector
    information: Vector
    residual: float  # 0: the pictures agree; 1: as different as unrelated ones
    points: int


def fit_shift(now: Vector, before: Picture, x: Vector, y: Vector, scale: float) -> Fit:
    """Fit ``now`` = ``before`` at (x, y) + shift, positions in texels; ``scale`` is the size of a residual that counts
    in full.
    """
    shift = np.zeros(2)
    information = np.zeros((2, 2))
    for _ in range(ITERATIONS):
        left, slope, weight = _linear(now, before, x + shift[0], y + shift[1], scale)
        information = (slope * weight) @ slope.T
        if len(left) < LEAST_POINTS or np.linalg.cond(information) > 1e6:
            break
        step = np.linalg.solve(information, (slope * weight) @ left)
        shift += np.clip(step, -0.5, 0.5)
        if np.abs(shift).max() > FARTHEST_PX:
            shift = np.clip(shift, -FARTHEST_PX, FARTHEST_PX)
            break
        if np.abs(step).max() < 1e-3:
            break
    found = residual_of(now, before, x + shift[0], y + shift[1], scale)
    noise = max(found, 1e-3) * scale
    return Fit(shift, information / noise**2, found, len(now))


def residual_of(now: Vector, before: Picture, x: Vector, y: Vector, scale: float) -> float:
    """Mean of min(|difference| / scale, 1) over the points; what lies outside the earlier picture counts 1."""
    if not len(now):
        return 1.0
    difference = np.abs(now - sample(before.signal, x, y)) / scale
    return float(np.minimum(np.nan_to_num(difference, nan=1.0), 1.0).mean())


def _linear(now: Vector, before: Picture, x: Vector, y: Vector, scale: float) -> tuple[Vector, Vector, Vector]:
    """Residuals, gradients [2, n] and robust weights (Geman-McClure) of the points inside the earlier picture."""
    there = sample(before.signal, x, y)
    inside = np.isfinite(there)
    left = (now - there)[inside]
    slope = sample(before.gradient, x[inside], y[inside])
    weight = 1.0 / (1.0 + (left / scale) ** 2) ** 2
    return left, slope, weight
