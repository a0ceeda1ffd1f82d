"""Twin of ``taa/neighbourhood.h``: the 3x3, row by row; a row is all rows of the image at one offset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.constants import value
from cltaa.core.parameters import Box, BoxSpace, CurrentFilter, Dilation, Neighbourhood, Variance
from cltaa.reference.colour import Colour, from_box_space, luminance, to_box_space, to_range
from cltaa.reference.real import Array, Mask, Run, greater, lesser, limit, neighbour, number, outside_domain


class Moments(NamedTuple):
    """Shifted moments: mean = shift + offset, spread = 3/2 of the sum of squared distances from the mean.

    Each [3, H, W], by channel.
    """

    shift: Array
    offset: Array
    spread: Array
    low: Array
    high: Array


def spread_of_three(a: Array, b: Array) -> Array:
    """3/2 of the spread of a, b and 0."""
    return a * (a - b) + b * b


def row_moments(left: Array, centre: Array, right: Array) -> Moments:
    """Three texels, shifted by the centre one."""
    dl, dr = left - centre, right - centre
    offset = (dl + dr) * value("ONE_THIRD")
    low, high = lesser(lesser(left, right), centre), greater(greater(left, right), centre)
    return Moments(centre, offset, spread_of_three(dl, dr), low, high)


def window_moments(above: Moments, centre: Moments, below: Moments) -> Moments:
    """Join three rows of three (Chan, Golub and LeVeque 1983); the kernels keep what two rows have in common."""
    da = (above.shift - centre.shift) + (above.offset - centre.offset)
    db = (below.shift - centre.shift) + (below.offset - centre.offset)
    return Moments(
        centre.shift,
        centre.offset + (da + db) * value("ONE_THIRD"),
        ((above.spread + centre.spread) + below.spread) + 3.0 * spread_of_three(da, db),
        lesser(lesser(above.low, centre.low), below.low),
        greater(greater(above.high, centre.high), below.high),
    )


def naive_row(m: Moments, left: Array, centre: Array, right: Array) -> Moments:
    """Sum and sum of squares of three texels, as offset and spread."""
    return m._replace(offset=(left + right) + centre, spread=(left * left + right * right) + centre * centre)


def naive_window(m: Moments, above: Moments, centre: Moments, below: Moments) -> Moments:
    """The mean of such rows as shift, E[x^2] - E[x]^2 as spread."""
    share = value("ONE_NINTH")
    mean = ((above.offset + below.offset) + centre.offset) * share
    squares = (above.spread + below.spread) + centre.spread
    return m._replace(shift=mean, offset=np.zeros_like(mean), spread=squares * share - mean * mean)


def chosen_row(left: Array, centre: Array, right: Array, build: Build) -> Moments:
    """Moments of a row, in the form that the chosen variance needs."""
    m = row_moments(left, centre, right)
    return naive_row(m, left, centre, right) if build.choices.variance is Variance.NAIVE else m


def deviation_of(m: Moments, build: Build) -> Array:
    """The root of the variance; 0 where rounding made the naive one negative."""
    naive = build.choices.variance is Variance.NAIVE
    variance = greater(m.spread, 0.0) if naive else m.spread * value("TWO_27THS")
    return np.sqrt(variance)


def neighbourhood_moments(above: Moments, centre: Moments, below: Moments, build: Build) -> Moments:
    """Moments of the 3x3."""
    m = window_moments(above, centre, below)
    if build.choices.box is Box.ROUNDED:
        m = _rounded(m, above, centre, below)
    return naive_window(m, above, centre, below) if build.choices.variance is Variance.NAIVE else m


def _rounded(m: Moments, above: Moments, centre: Moments, below: Moments) -> Moments:
    """``m`` with the mean of the extremes of the 3x3 and of the cross."""
    low = 0.5 * (m.low + lesser(lesser(above.shift, below.shift), centre.low))
    high = 0.5 * (m.high + greater(greater(above.shift, below.shift), centre.high))
    return m._replace(low=low, high=high)


class Row(NamedTuple):
    """What the three texels of a row contribute; ``moments`` in the kernels' coordinates (``box_units``)."""

    moments: Moments
    texels: tuple[Colour, Colour, Colour]  # left, own, right, in the kernels' coordinates
    centre: Colour
    across: Colour
    nearest: Array
    nearest_x: Array
    farthest: Array
    inverse_depth: Array
    rise: Array
    u: Array
    v: Array
    centre_u: Array
    centre_v: Array


class Statistics(NamedTuple):
    """Statistics of the neighbourhood, in the kernels' coordinates."""

    mean: Colour
    deviation: Colour
    low: Colour
    high: Colour


class Surface(NamedTuple):
    """The surface whose motion a pixel follows."""

    x: Array
    y: Array
    inverse_depth: Array
    u: Array
    v: Array
    centre: Array
    nearest: Array
    farthest: Array


def texel_weights(texels: Sequence[Colour], run: Run) -> list[Any]:
    """Weights of nine texels: 1 / (1 + Y), or by the distance of their samples from the pixel's centre."""
    one = number(1.0, texels[0])
    if run.choices.neighbourhood is Neighbourhood.JITTERED:
        columns = number(run.frame["box_left"], one), one, number(run.frame["box_right"], one)
        rows = number(run.frame["box_above"], one), one, number(run.frame["box_below"], one)
        return [across * down for down in rows for across in columns]
    in_ycocg = run.choices.box_space is BoxSpace.YCOCG
    lights = [0.25 * t[0] if in_ycocg else luminance(t) for t in texels]
    return [one / (one + greater(y, 0.0)) for y in lights]


def weighted_statistics(texels: Sequence[Colour], run: Run) -> tuple[Colour, Colour]:
    """Weighted mean and deviation of nine texels, in the kernels' coordinates."""
    weights = texel_weights(texels, run)
    shift = spread = np.zeros_like(texels[0])
    total = shift[0]
    for w, v in zip(weights, texels, strict=True):
        total, shift = total + w, shift + w * (v - texels[4])
    mean = texels[4] + shift / total
    for w, v in zip(weights, texels, strict=True):
        spread = spread + w * ((v - mean) * (v - mean))
    return mean, np.sqrt(spread / total)


def neighbourhood_statistics(above: Row, centre: Row, below: Row, run: Run) -> Statistics:
    """Mean, deviation and extremes of each channel."""
    m = neighbourhood_moments(above.moments, centre.moments, below.moments, run.build)
    mean, deviation = m.shift + m.offset, deviation_of(m, run.build)
    if run.choices.neighbourhood in (Neighbourhood.LUMINANCE, Neighbourhood.JITTERED):
        mean, deviation = weighted_statistics((*above.texels, *centre.texels, *below.texels), run)
        mean = limit(mean, m.low, m.high)
    return Statistics(mean, deviation, m.low, m.high)


def filter_three(before: Colour, middle: Colour, after: Colour, first: Any, last: Any, build: Build) -> Colour:
    """Weight three colours as the middle one plus weighted differences from it."""
    if build.choices.current_filter is CurrentFilter.NONE:
        return middle
    return middle + (first * (before - middle) + last * (after - middle))


def current_sample(above: Row, centre: Row, below: Row, near: Statistics, run: Run) -> Colour:
    """The pixel's own sample, or the one that the current filter reconstructs at its centre."""
    if run.choices.current_filter is CurrentFilter.NONE:
        return centre.centre
    v = filter_three(
        above.across, centre.across, below.across, run.frame["above_weight"], run.frame["below_weight"], run.build
    )
    if run.choices.current_filter is not CurrentFilter.LANCZOS:
        return v
    b = to_box_space(v, run.build)
    return v + from_box_space(limit(b, near.low, near.high) - b, run.build)


def inverse_depth_or_sky(v: Array, frame: Record) -> Array:
    """Replace inverse depth outside the domain by the sky's."""
    return np.where(outside_domain(v), frame["sky_inverse_depth"], v)


def read_row(colour: Array, inverse_depth: Array, motion: Array | None, dy: int, run: Run) -> Row:
    """Rows y + ``dy`` of repaired colour planes, inverse depth [1, rows, stride] and motion [2, rows, stride]."""

    def window(planes: Array, dx: int) -> Array:
        return neighbour(planes, dx, dy, run.layout)

    left, centre, right = [to_range(window(colour, dx), run.build) for dx in (-1, 0, 1)]
    texels = to_box_space(left, run.build), to_box_space(centre, run.build), to_box_space(right, run.build)
    in_domain = inverse_depth_or_sky(inverse_depth[0], run.frame)
    zl, zc, zr = (window(in_domain, dx) for dx in (-1, 0, 1))
    to_left = zl > zc
    nearest = greater(zl, zc)
    to_right = zr > nearest
    nearest = greater(zr, nearest)
    nearest_x = np.where(to_right, 1, np.where(to_left, number(-1, zc), number(0, zc)))
    zero = np.zeros_like(zc)
    u = v = centre_u = centre_v = zero
    if run.steps.own_motion and motion is not None:
        u, v = np.where(to_right, window(motion, 1), np.where(to_left, window(motion, -1), window(motion, 0)))
        centre_u, centre_v = window(motion, 0)
    return Row(
        chosen_row(*texels, run.build),
        texels,
        centre,
        filter_three(left, centre, right, run.frame["left_weight"], run.frame["right_weight"], run.build),
        nearest,
        nearest_x,
        lesser(lesser(zl, zr), zc),
        zc,
        zr - zl,
        u,
        v,
        centre_u,
        centre_v,
    )


def has_edge(s: Surface, run: Run) -> Mask:
    """True where a depth edge runs through the 3x3."""
    skew = (s.nearest - s.centre) - (s.centre - s.farthest)
    edge: Mask = np.abs(skew) > run.settings["edge_tolerance"] * np.abs(s.nearest)
    return edge


def nearest_surface(above: Row, centre: Row, below: Row, run: Run) -> Surface:
    """The nearest surface of the 3x3, or the pixel's own, by the build's dilation."""
    zero = np.zeros_like(centre.inverse_depth)
    nearer = greater(above.nearest, centre.nearest)
    nearest = greater(below.nearest, nearer)
    farthest = lesser(lesser(above.farthest, below.farthest), centre.farthest)
    own = Surface(
        zero, zero, centre.inverse_depth, centre.centre_u, centre.centre_v, centre.inverse_depth, nearest, farthest
    )
    if run.choices.dilation in (Dilation.NONE, Dilation.CORNERS, Dilation.BESIDE):
        return own
    up = above.nearest > centre.nearest
    down = below.nearest > nearer
    across = has_edge(own, run) if run.choices.dilation is Dilation.EDGE else np.ones_like(up)

    def pick(a: Array, c: Array, b: Array, otherwise: Array) -> Array:
        return np.where(across, np.where(down, b, np.where(up, a, c)), otherwise)

    one = np.ones_like(zero)
    return own._replace(
        inverse_depth=np.where(across, nearest, own.inverse_depth),
        x=pick(above.nearest_x, centre.nearest_x, below.nearest_x, zero),
        y=pick(-one, zero, one, zero),
        u=pick(above.u, centre.u, below.u, own.u),
        v=pick(above.v, centre.v, below.v, own.v),
    )
