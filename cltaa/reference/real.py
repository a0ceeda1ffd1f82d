"""Twin of ``platform/real.h``: the guards and comparisons that every stage uses, on arrays of float32 or float64."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.core.build import Build, Real, Steps
from cltaa.core.constants import PAD_X, PAD_Y, value
from cltaa.core.parameters import Choices
from cltaa.core.planes import Layout

Array = NDArray[Any]  # [H, W] of the stage's real
Mask = NDArray[np.bool_]  # [H, W]

NEIGHBOURS = [(dx, dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]  # of the 3x3, row by row


class Run(NamedTuple):
    """What all pixels of one run of a kernel share: the build, the layout of the planes, and the kernel's structs."""

    build: Build
    layout: Layout
    frame: Any = None  # these two of a kernel that takes them
    settings: Any = None

    @property
    def choices(self) -> Choices:
        """The choices of the build."""
        return self.build.choices

    @property
    def steps(self) -> Steps:
        """The steps of the build."""
        return self.build.steps


# Values that are not selected may overflow, and be divided by weights whose squares are 0, as on a device.
quiet = np.errstate(over="ignore", invalid="ignore", divide="ignore")


def real_type(build: Build) -> Any:
    """NumPy type of the build's real."""
    return np.float64 if build.real is Real.DOUBLE else np.float32


def number(v: Any, like: Array) -> Any:
    """A coefficient or a struct member in the precision of ``like``, for arithmetic between two of them.

    Beside an array NumPy itself gives them the precision of the array.
    """
    return like.dtype.type(v)


def neighbour(planes: Array, dx: int, dy: int, layout: Layout) -> Array:
    """For every pixel the texel ``dx`` columns and ``dy`` rows beside it, from padded planes [..., rows, stride]."""
    top, left = PAD_Y + dy, PAD_X + dx
    return planes[..., top : top + layout.height, left : left + layout.width]


def greater(a: Array, b: Any) -> Array:
    """``a > b ? a : b``."""
    return np.where(a > b, a, b)


def lesser(a: Array, b: Any) -> Array:
    """``a < b ? a : b``."""
    return np.where(a < b, a, b)


def limit(v: Array, lo: Any, hi: Any) -> Array:
    """Clamp ``v`` to [lo, hi]."""
    return lesser(greater(v, lo), hi)


def outside_domain(v: Array) -> Mask:
    """True where ``v`` is NaN, infinite or beyond DOMAIN_LIMIT."""
    inside: Mask = np.abs(v) <= value("DOMAIN_LIMIT")
    return ~inside
