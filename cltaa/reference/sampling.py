"""Twin of ``taa/sampling.h`` and ``schedule/footprint.h``: reads the previous frame between its texels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.core.build import Build
from cltaa.core.constants import PAD_X, PAD_Y
from cltaa.core.parameters import HistoryFilter
from cltaa.core.planes import Layout
from cltaa.reference.real import Array, Mask, Run, greater, lesser, limit, number
from cltaa.reference.reprojection import Motion

FIVE_PAIRS: Final = (HistoryFilter.CATMULL_ROM_5, HistoryFilter.CATMULL_ROM_5_RAW)


class Weights(NamedTuple):
    """Weights of all taps but tap 1; for Catmull-Rom's 16 taps of the steps between taps; for the cross what the six
    taps, tap 1 among them, add to a linear filter, and ``linear`` is tap 2's weight in that filter."""

    first: Array
    w0: Array
    w1: Array
    w2: Array
    w3: Array
    last: Array
    linear: Array


class RowTaps(NamedTuple):
    """A filtered row: its mean, or a pair in the middle and what the sides add to it; for the cross taps 1 and 2, and
    what the six add to a linear filter between them."""

    middle: Array
    right: Array
    sides: Array


def catmull_rom(t: Array, build: Build) -> Weights:
    """Catmull and Rom 1974, tension 1/2, at fraction ``t``."""
    w3 = (t * t) * (-0.5 + 0.5 * t)
    if build.choices.history_filter in FIVE_PAIRS:
        w0 = t * (-0.5 + t * (1.0 - 0.5 * t))
        w2 = t * (0.5 + t * (2.0 - 1.5 * t)) / (1.0 - (w0 + w3))
    else:
        w0 = t * (0.5 - t * (1.0 - 0.5 * t))
        w2 = t * (0.5 + t * (1.5 - t))
    zero = np.zeros_like(t)
    return Weights(zero, w0, zero, w2, w3, zero, zero)


def least_squares(t: Array) -> Weights:
    """Six taps at fraction ``t`` whose response is nearest to a displacement by ``t`` up to 0.3 cycles a texel, of all
    weights t (1 - t) (a + b t) that preserve ramps and parabolas (Laakso et al. 1996)."""
    u = 1.0 - t
    both = t * u
    first, last = both * (0.105 - 0.0376 * t), both * (0.105 - 0.0376 * u)
    w0, w3 = both * (0.3342 * t - 0.6758), both * (0.3342 * u - 0.6758)
    w2 = ((first + first) + w0) - ((w3 + w3) + 3.0 * last)
    w1 = -(((first + last) + (w0 + w3)) + w2)
    return Weights(first, w0, w1, w2, w3, last, t)


def history_weights(t: Array, build: Build) -> Weights:
    """Weights at fraction ``t`` of the build's history filter."""
    kind = build.choices.history_filter
    zero = np.zeros_like(t)
    if kind is HistoryFilter.NEAREST:
        return Weights(zero, zero, zero, np.where(t >= 0.5, np.ones_like(t), 0.0), zero, zero, zero)
    if kind is HistoryFilter.BILINEAR:
        return Weights(zero, zero, zero, t, zero, zero, zero)
    return least_squares(t) if kind is HistoryFilter.CROSS_20 else catmull_rom(t, build)


def six_taps(p: Sequence[Array], w: Weights) -> Array:
    """What six taps add to a linear filter."""
    first, p0, p1, p2, p3, last = p
    return ((((w.first * first + w.last * last) + w.w0 * p0) + w.w3 * p3) + w.w1 * p1) + w.w2 * p2


def lerp(a: Array, b: Array, t: Array) -> Array:
    """Interpolate linearly from ``a`` to ``b``."""
    return a + t * (b - a)


def filter_taps(p: Sequence[Array], w: Weights, build: Build) -> RowTaps:
    """Filter the taps of a line: one of them, or their pair in the middle, plus weighted differences from it."""
    kind = build.choices.history_filter
    if kind is HistoryFilter.CROSS_20:
        return RowTaps(p[2], p[3], six_taps(p, w))
    p0, p1, p2, p3 = p
    pair: Array = p1 + w.w2 * (p2 - p1)
    middle, sides = pair, np.zeros_like(pair)
    if kind is HistoryFilter.CATMULL_ROM:
        middle = ((p1 + w.w0 * (p1 - p0)) + w.w2 * (p2 - p1)) + w.w3 * (p3 - p2)
    if kind in FIVE_PAIRS:
        sides = w.w0 * (p0 - pair) + w.w3 * (p3 - pair)
    return RowTaps(middle, pair, sides)


def cross_of(rows: Sequence[RowTaps], wx: Weights, wy: Weights) -> Array:
    """Both arms of the cross, clamped to the range of the four middle texels plus a quarter of it at either end, but
    of the darkest texel below, if that is less."""
    r1, r2 = rows[2], rows[3]
    left = lerp(r1.middle, r2.middle, wy.linear) + six_taps([row.middle for row in rows], wy)
    right = lerp(r1.right, r2.right, wy.linear) + six_taps([row.right for row in rows], wy)
    low = lesser(lesser(r1.middle, r1.right), lesser(r2.middle, r2.right))
    high = greater(greater(r1.middle, r1.right), greater(r2.middle, r2.right))
    span, along_x = high - low, lerp(r1.sides, r2.sides, wy.linear)
    read = lerp(left, right, wx.linear) + along_x
    return limit(read, low - 0.25 * lesser(span, np.abs(low)), high + 0.25 * span)


def without_corners(rows: Sequence[RowTaps], wx: Weights, wy: Weights, build: Build) -> Array:
    """Five of the nine pairs of Catmull-Rom, normalised to sum to 1 (Jimenez 2016), or left raw."""
    r0, r1, r2, r3 = rows
    pair_x, pair_y = 1.0 - (wx.w0 + wx.w3), 1.0 - (wy.w0 + wy.w3)
    centre = r1.middle + wy.w2 * (r2.middle - r1.middle)
    sides = r1.sides + wy.w2 * (r2.sides - r1.sides)
    ends = wy.w0 * (r0.middle - centre) + wy.w3 * (r3.middle - centre)
    total, rest = pair_y + pair_x * (1.0 - pair_y), pair_y * sides + pair_x * ends
    raw = build.choices.history_filter is HistoryFilter.CATMULL_ROM_5_RAW
    return total * centre + rest if raw else centre + rest / total


def filter_rows(rows: Sequence[RowTaps], wx: Weights, wy: Weights, build: Build) -> Array:
    """Filter rows along y."""
    if build.choices.history_filter is HistoryFilter.CROSS_20:
        return cross_of(rows, wx, wy)
    if build.choices.history_filter in FIVE_PAIRS:
        return without_corners(rows, wx, wy, build)
    return filter_taps([row.middle for row in rows], wy, build).middle


class Footprint(NamedTuple):
    """Integer texel (row, column in the padded plane) and fraction of each pixel's history position."""

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
    """Footprint of each valid pixel's history position; others get their own texel."""
    u, v = np.where(valid, m.u, 0.0), np.where(valid, m.v, 0.0)
    dx, dy = np.floor(u), np.floor(v)
    y, x = np.mgrid[: layout.height, : layout.width]
    return Footprint(y + dy.astype(np.int64) + PAD_Y, x + dx.astype(np.int64) + PAD_X, u - dx, v - dy)


def sample_plane(plane: Array, f: Footprint, wx: Weights, wy: Weights, build: Build, real: Any) -> Array:
    """Filter the padded plane [rows, stride] at the footprint, along x first."""
    reach = range(-2, 4) if build.choices.history_filter is HistoryFilter.CROSS_20 else range(-1, 3)
    rows: list[RowTaps] = []
    for j in reach:
        taps = [plane[f.row + j, f.column + i].astype(real) for i in reach]
        rows.append(filter_taps(taps, wx, build))
    return filter_rows(rows, wx, wy, build)


def sample_quad(plane: Array, f: Footprint, real: Any) -> Quad:
    """The four texels around the footprint."""
    return Quad(*(plane[f.row + j, f.column + i].astype(real) for j in (0, 1) for i in (0, 1)))


def sample_corners(plane: Array, f: Footprint, real: Any) -> Quad:
    """The corners of the 4x4 around the footprint."""
    return Quad(*(plane[f.row + j, f.column + i].astype(real) for j in (-1, 2) for i in (-1, 2)))


def bilinear(q: Quad, f: Footprint) -> Array:
    """Interpolate the quad at the footprint's fraction."""
    top, bottom = q.p00 + f.fx * (q.p10 - q.p00), q.p01 + f.fx * (q.p11 - q.p01)
    return top + f.fy * (bottom - top)


def count_limit_of(fx: Array, fy: Array, run: Run) -> Array:
    """Upper limit of the sample count of a history resampled at fraction ``fx``, ``fy``."""
    one = number(1.0, fx)
    least = one / number(run.settings["sample_limit"], fx)
    if run.build.terms.resampling_penalty:
        least = least + run.settings["resampling_penalty"] * (fx * (one - fx) + fy * (one - fy))
    return one / least
