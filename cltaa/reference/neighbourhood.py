"""Twin of ``taa/neighbourhood.h``: the 3x3, row by row; a row is all rows of the image at one offset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.constants import PAD_X, PAD_Y
from cltaa.core.parameters import Box, BoxSpace, CurrentFilter, Dilation, Neighbourhood, Variance
from cltaa.core.planes import Layout
from cltaa.reference.colour import Colour, from_box_space, in_units, luminance, to_box_space, to_boxed, to_range
from cltaa.reference.real import Array, constant, greater, lesser, limit, number, outside_domain


class Moments(NamedTuple):
    """Shifted moments: mean = shift + offset, spread = sum of squared distances from the mean; of three, 3/2 of it."""

    shift: Array
    offset: Array
    spread: Array
    low: Array
    high: Array


def spread_of_three(a: Array, b: Array) -> Array:
    """3/2 of the spread of a, b and 0."""
    spread: Array = a * (a - b) + b * b
    return spread


def row_moments(left: Array, centre: Array, right: Array) -> Moments:
    """Three texels, shifted by the centre one."""
    dl, dr = left - centre, right - centre
    offset = (dl + dr) * constant("ONE_THIRD", centre)
    low, high = lesser(lesser(left, right), centre), greater(greater(left, right), centre)
    return Moments(centre, offset, spread_of_three(dl, dr), low, high)


def window_moments(above: Moments, centre: Moments, below: Moments) -> Moments:
    """Three rows of three (Chan, Golub and LeVeque 1983); the kernels keep what two rows have in common."""
    da = (above.shift - centre.shift) + (above.offset - centre.offset)
    db = (below.shift - centre.shift) + (below.offset - centre.offset)
    return Moments(
        centre.shift,
        centre.offset + (da + db) * constant("ONE_THIRD", da),
        ((above.spread + centre.spread) + below.spread) + number(3.0, da) * spread_of_three(da, db),
        lesser(lesser(above.low, centre.low), below.low),
        greater(greater(above.high, centre.high), below.high),
    )


def naive_row(m: Moments, left: Array, centre: Array, right: Array) -> Moments:
    """Sum and sum of squares of three texels, as offset and spread."""
    return m._replace(offset=(left + right) + centre, spread=(left * left + right * right) + centre * centre)


def naive_window(m: Moments, above: Moments, centre: Moments, below: Moments) -> Moments:
    """The mean of such rows as shift, E[x^2] - E[x]^2 as spread."""
    share = constant("ONE_NINTH", centre.shift)
    mean = ((above.offset + below.offset) + centre.offset) * share
    squares = (above.spread + below.spread) + centre.spread
    return m._replace(shift=mean, offset=np.zeros_like(mean), spread=squares * share - mean * mean)


def chosen_row(left: Array, centre: Array, right: Array, build: Build) -> Moments:
    """The moments of a row as the chosen variance needs them."""
    m = row_moments(left, centre, right)
    return naive_row(m, left, centre, right) if build.choices.variance is Variance.NAIVE else m


def deviation_of(m: Moments, build: Build) -> Array:
    """The root of the variance; of 0, where rounding made the naive one less."""
    naive = build.choices.variance is Variance.NAIVE
    variance = greater(m.spread, number(0.0, m.spread)) if naive else m.spread * constant("TWO_27THS", m.spread)
    deviation: Array = np.sqrt(variance)
    return deviation


def neighbourhood_moments(above: Moments, centre: Moments, below: Moments, build: Build) -> Moments:
    """Of one channel."""
    m = window_moments(above, centre, below)
    if build.choices.box is Box.ROUNDED:
        m = _rounded(m, above, centre, below)
    return naive_window(m, above, centre, below) if build.choices.variance is Variance.NAIVE else m


def _rounded(m: Moments, above: Moments, centre: Moments, below: Moments) -> Moments:
    """``m`` with the mean of the extremes of the 3x3 and of the cross."""
    half = number(0.5, m.low)
    low = half * (m.low + lesser(lesser(above.shift, below.shift), centre.low))
    high = half * (m.high + greater(greater(above.shift, below.shift), centre.high))
    return m._replace(low=low, high=high)


class Row(NamedTuple):
    """What the three texels of a row contribute; ``channels`` in the kernels' coordinates (``box_units``)."""

    channels: tuple[Moments, Moments, Moments]
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
    """Of the neighbourhood, in the box space; four colours."""

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


def texel_weights(texels: Sequence[Colour], build: Build, frame: Record) -> list[Any]:
    """Weights of nine texels: 1 / (1 + Y), or by the distance of their samples from the pixel's centre."""
    one = number(1.0, texels[0][0])
    if build.choices.neighbourhood is Neighbourhood.JITTERED:
        columns = number(frame["box_left"], one), one, number(frame["box_right"], one)
        rows = number(frame["box_above"], one), one, number(frame["box_below"], one)
        return [across * down for down in rows for across in columns]
    in_ycocg = build.choices.box_space is BoxSpace.YCOCG
    lights = [number(0.25, one) * t[0] if in_ycocg else luminance(t) for t in texels]
    return [one / (one + greater(y, number(0.0, one))) for y in lights]


def weighed_texels(texels: Sequence[Colour], build: Build, frame: Record) -> tuple[list[Array], list[Array]]:
    """Mean and deviation a channel of nine texels in the kernels' coordinates, each with its weight."""
    zero, weights = np.zeros_like(texels[0][0]), texel_weights(texels, build, frame)
    total = zero
    for w in weights:
        total = total + w
    means, deviations = [], []
    for channel in zip(*texels, strict=True):
        shift, spread = zero, zero
        for w, v in zip(weights, channel, strict=True):
            shift = shift + w * (v - channel[4])
        mean = channel[4] + shift / total
        for w, v in zip(weights, channel, strict=True):
            spread = spread + w * ((v - mean) * (v - mean))
        means.append(mean)
        deviations.append(np.sqrt(spread / total))
    return means, deviations


def neighbourhood_statistics(above: Row, centre: Row, below: Row, build: Build, frame: Record) -> Statistics:
    """Mean, deviation and extremes of each channel."""
    rows = zip(above.channels, centre.channels, below.channels, strict=True)
    parts = [neighbourhood_moments(a, c, b, build) for a, c, b in rows]
    mean, deviation = [m.shift + m.offset for m in parts], [deviation_of(m, build) for m in parts]
    if build.choices.neighbourhood in (Neighbourhood.LUMINANCE, Neighbourhood.JITTERED):
        mean, deviation = weighed_texels((*above.texels, *centre.texels, *below.texels), build, frame)
        mean = [limit(value, part.low, part.high) for value, part in zip(mean, parts, strict=True)]
    each = mean, deviation, [m.low for m in parts], [m.high for m in parts]
    return Statistics(*(in_units(_three(colour), build) for colour in each))


def weigh_line(before: Colour, middle: Colour, after: Colour, first: Any, last: Any, build: Build) -> Colour:
    """Three colours weighed as the middle one plus weighted differences from it."""
    if build.choices.current_filter is CurrentFilter.NONE:
        return middle
    k, n = number(first, middle[0]), number(last, middle[0])
    parts = [m + (k * (b - m) + n * (a - m)) for b, m, a in zip(before, middle, after, strict=True)]
    return _three(parts)


def current_sample(above: Row, centre: Row, below: Row, near: Statistics, build: Build, frame: Record) -> Colour:
    """The pixel's own sample, or the one that the current filter rebuilds at its centre."""
    if build.choices.current_filter is CurrentFilter.NONE:
        return centre.centre
    v = weigh_line(above.across, centre.across, below.across, frame["above_weight"], frame["below_weight"], build)
    if build.choices.current_filter is not CurrentFilter.LANCZOS:
        return v
    over = [limit(b, lo, hi) - b for b, lo, hi in zip(to_box_space(v, build), near.low, near.high, strict=True)]
    change = from_box_space(_three(over), build)
    return v[0] + change[0], v[1] + change[1], v[2] + change[2]


def inverse_depth_or_sky(v: Array, frame: Record) -> Array:
    """Inverse depth outside the domain is the sky's."""
    return np.where(outside_domain(v), number(frame["sky_inverse_depth"], v), v)


def read_row(
    colour: Array, inverse_depth: Array, motion: Array | None, dy: int, build: Build, layout: Layout, frame: Record
) -> Row:
    """Rows y + ``dy`` of repaired colour planes, inverse depth [1, rows, stride] and motion [2, rows, stride]."""

    def window(plane: Array, dx: int) -> Array:
        top, left = PAD_Y + dy, PAD_X + dx
        return plane[top : top + layout.height, left : left + layout.width]

    def texels(dx: int) -> Colour:
        return to_range((window(colour[0], dx), window(colour[1], dx), window(colour[2], dx)), build)

    line = texels(-1), texels(0), texels(1)
    left, centre, right = (to_boxed(v, build) for v in line)
    texels_of = list(zip(left, centre, right, strict=True))
    channels = [chosen_row(*three, build) for three in texels_of]
    in_domain = inverse_depth_or_sky(inverse_depth[0], frame)
    zl, zc, zr = (window(in_domain, dx) for dx in (-1, 0, 1))
    to_left = zl > zc
    nearest = greater(zl, zc)
    to_right = zr > nearest
    nearest = greater(zr, nearest)
    nearest_x = np.where(to_right, number(1, zc), np.where(to_left, number(-1, zc), number(0, zc)))
    zero = np.zeros_like(zc)
    u = v = centre_u = centre_v = zero
    if build.steps.own_motion and motion is not None:
        u, v = (
            np.where(to_right, window(plane, 1), np.where(to_left, window(plane, -1), window(plane, 0)))
            for plane in motion
        )
        centre_u, centre_v = (window(plane, 0) for plane in motion)
    return Row(
        (channels[0], channels[1], channels[2]),
        (left, centre, right),
        line[1],
        weigh_line(*line, frame["left_weight"], frame["right_weight"], build),
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


def nearest_surface(above: Row, centre: Row, below: Row, build: Build, edge_tolerance: Any) -> Surface:
    """The nearest surface of the 3x3, or the pixel's own, as the build's dilation says."""
    zero = np.zeros_like(centre.inverse_depth)
    nearer = greater(above.nearest, centre.nearest)
    nearest = greater(below.nearest, nearer)
    farthest = lesser(lesser(above.farthest, below.farthest), centre.farthest)
    own = Surface(
        zero, zero, centre.inverse_depth, centre.centre_u, centre.centre_v, centre.inverse_depth, nearest, farthest
    )
    if build.choices.dilation in (Dilation.NONE, Dilation.CORNERS, Dilation.BESIDE):
        return own
    up = above.nearest > centre.nearest
    down = below.nearest > nearer
    across = np.ones_like(up)
    if build.choices.dilation is Dilation.EDGE:
        skew = (nearest - centre.inverse_depth) - (centre.inverse_depth - farthest)
        across = np.abs(skew) > number(edge_tolerance, zero) * np.abs(nearest)

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


def _three(parts: list[Array]) -> Colour:
    return parts[0], parts[1], parts[2]
