"""Twin of ``neighbourhood.h``: the 3x3 row by row; a row is all rows of the image at one offset."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cltaa.constants import PAD_X, PAD_Y
from cltaa.memory.layout import Layout
from cltaa.parameters.build import Build, Record
from cltaa.parameters.choices import CurrentFilter, Dilation
from cltaa.reference.colour import Colour, from_box_space, in_units, to_box_space, to_boxed, to_range
from cltaa.reference.moments import Moments, chosen_row, deviation_of, neighbourhood_moments, row_moments
from cltaa.reference.real import Array, greater, lesser, limit, number, outside_domain


class Row(NamedTuple):
    """What the three texels of a row contribute; ``channels`` in the kernels' coordinates (``box_units``)."""

    channels: tuple[Moments, Moments, Moments]
    centre: Colour
    across: Colour
    nearest: Array
    nearest_x: Array
    farthest: Array
    closeness: Array
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
    closeness: Array
    u: Array
    v: Array
    centre: Array
    nearest: Array
    farthest: Array


def neighbourhood_statistics(above: Row, centre: Row, below: Row, build: Build) -> Statistics:
    """Mean, deviation and extremes of each channel."""
    rows = zip(above.channels, centre.channels, below.channels, strict=True)
    parts = [neighbourhood_moments(a, c, b, build) for a, c, b in rows]
    mean, deviation = [m.shift + m.offset for m in parts], [deviation_of(m, build) for m in parts]
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


def usable_closeness(v: Array, frame: Record) -> Array:
    """Closeness outside the domain is the sky's."""
    return np.where(outside_domain(v), number(frame["sky_closeness"], v), v)


def read_row(
    colour: Array, closeness: Array, motion: Array | None, dy: int, build: Build, layout: Layout, frame: Record
) -> Row:
    """Rows y + ``dy`` of repaired colour planes, closeness [1, rows, stride] and motion [2, rows, stride]."""

    def window(plane: Array, dx: int) -> Array:
        top, left = PAD_Y + dy, PAD_X + dx
        return plane[top : top + layout.height, left : left + layout.width]

    def texels(dx: int) -> Colour:
        return to_range((window(colour[0], dx), window(colour[1], dx), window(colour[2], dx)), build)

    line = texels(-1), texels(0), texels(1)
    left, centre, right = (to_boxed(v, build) for v in line)
    texels_of = list(zip(left, centre, right, strict=True))
    channels = [chosen_row(row_moments(*three), *three, build) for three in texels_of]
    usable = usable_closeness(closeness[0], frame)
    zl, zc, zr = (window(usable, dx) for dx in (-1, 0, 1))
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
    zero = np.zeros_like(centre.closeness)
    nearer = greater(above.nearest, centre.nearest)
    nearest = greater(below.nearest, nearer)
    farthest = lesser(lesser(above.farthest, below.farthest), centre.farthest)
    own = Surface(zero, zero, centre.closeness, centre.centre_u, centre.centre_v, centre.closeness, nearest, farthest)
    if build.choices.dilation is Dilation.NONE:
        return own
    up = above.nearest > centre.nearest
    down = below.nearest > nearer
    across = np.ones_like(up)
    if build.choices.dilation is Dilation.EDGE:
        skew = (nearest - centre.closeness) - (centre.closeness - farthest)
        across = np.abs(skew) > number(edge_tolerance, zero) * np.abs(nearest)

    def pick(a: Array, c: Array, b: Array, otherwise: Array) -> Array:
        return np.where(across, np.where(down, b, np.where(up, a, c)), otherwise)

    one = np.ones_like(zero)
    return own._replace(
        closeness=np.where(across, nearest, own.closeness),
        x=pick(above.nearest_x, centre.nearest_x, below.nearest_x, zero),
        y=pick(-one, zero, one, zero),
        u=pick(above.u, centre.u, below.u, own.u),
        v=pick(above.v, centre.v, below.v, own.v),
    )


def _three(parts: list[Array]) -> Colour:
    return parts[0], parts[1], parts[2]
