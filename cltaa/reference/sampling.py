"""Twin of ``sampling.h``: reading the previous frame between its texels."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.constants import PAD_X, PAD_Y
from cltaa.memory.layout import Layout
from cltaa.parameters.build import Build
from cltaa.reference.history_filter import SIX_TAPS, Row, Weights, weigh, weigh_rows
from cltaa.reference.projection import Motion
from cltaa.reference.real import Array, Mask, number


class Footprint(NamedTuple):
    """Whole texel (row, column in the padded plane) and fraction of each pixel's history position."""

    row: NDArray[np.int64]
    column: NDArray[np.int64]
    fx: Array
    fy: Array


class Quad(NamedTuple):
    """The four texels around a footprint."""

    p00: Array
    p10: Array
    p01: Array
    p11: Array


def footprint_of(m: Motion, valid: Mask, layout: Layout) -> Footprint:
    """Where the history of each valid pixel lies; others look at their own texel."""
    zero = np.zeros_like(m.u)
    u, v = np.where(valid, m.u, zero), np.where(valid, m.v, zero)
    dx, dy = np.floor(u), np.floor(v)
    y, x = np.mgrid[: layout.height, : layout.width]
    return Footprint(y + dy.astype(np.int64) + PAD_Y, x + dx.astype(np.int64) + PAD_X, u - dx, v - dy)


def sample_plane(plane: Array, f: Footprint, wx: Weights, wy: Weights, build: Build, real: Any) -> Array:
    """The padded plane [rows, stride] filtered at the footprint, along x first."""
    reach = range(-2, 4) if build.choices.history_filter in SIX_TAPS else range(-1, 3)
    rows: list[Row] = []
    for j in reach:
        taps = [plane[f.row + j, f.column + i].astype(real) for i in reach]
        rows.append(weigh(taps, wx, build))
    return weigh_rows(rows, wx, wy, build)


def sample_quad(plane: Array, f: Footprint, real: Any) -> Quad:
    """The four texels around the footprint."""
    return Quad(*(plane[f.row + j, f.column + i].astype(real) for j in (0, 1) for i in (0, 1)))


def bilinear(q: Quad, f: Footprint) -> Array:
    """The quad interpolated at the footprint's fraction."""
    top, bottom = q.p00 + f.fx * (q.p10 - q.p00), q.p01 + f.fx * (q.p11 - q.p01)
    result: Array = top + f.fy * (bottom - top)
    return result


def between_texels(fx: Array, fy: Array) -> Array:
    """f (1 - f), summed over both axes: how far a position lies from the texels it is read from."""
    one = number(1.0, fx)
    result: Array = fx * (one - fx) + fy * (one - fy)
    return result
