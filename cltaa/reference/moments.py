"""Twin of ``moments.h``: mean, spread and extremes of a 3x3, row by row, of one channel."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cltaa.parameters.build import Build
from cltaa.parameters.choices import Box, Neighbourhood, Variance
from cltaa.reference.real import Array, constant, greater, lesser, number


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


def cross_moments(above: Moments, centre: Moments, below: Moments) -> Moments:
    """The centre row and the texels above and below its middle."""
    du, dd = above.shift - centre.shift, below.shift - centre.shift
    across = number(3.0, du) * centre.offset
    total = across + (du + dd)
    squares = (constant("TWO_THIRDS", du) * centre.spread + across * centre.offset) + (du * du + dd * dd)
    offset = total * constant("ONE_FIFTH", du)
    return Moments(
        centre.shift,
        offset,
        squares - total * offset,
        lesser(lesser(above.shift, below.shift), centre.low),
        greater(greater(above.shift, below.shift), centre.high),
    )


def weighted_row(m: Moments, left: Array, centre: Array, right: Array) -> Moments:
    """Three texels weighed 1 2 1."""
    dl, dr = left - centre, right - centre
    total = dl + dr
    offset = total * number(0.25, total)
    return m._replace(offset=offset, spread=(dl * dl + dr * dr) - total * offset)


def weighted_window(m: Moments, above: Moments, centre: Moments, below: Moments) -> Moments:
    """Three such rows weighed 1 2 1."""
    da = (above.shift - centre.shift) + (above.offset - centre.offset)
    db = (below.shift - centre.shift) + (below.offset - centre.offset)
    total = da + db
    offset = total * number(0.25, total)
    between = number(4.0, total) * ((da * da + db * db) - total * offset)
    inside = (above.spread + below.spread) + number(2.0, total) * centre.spread
    return m._replace(offset=centre.offset + offset, spread=inside + between)


def share_of_one(build: Build, like: Array) -> Any:
    """One over what all texels of the neighbourhood weigh together."""
    if build.choices.neighbourhood is Neighbourhood.WEIGHTED:
        return number(0.0625, like)
    return constant("ONE_FIFTH" if build.choices.neighbourhood is Neighbourhood.CROSS else "ONE_NINTH", like)


def _middle(build: Build, like: Array) -> Any:
    return number(2.0 if build.choices.neighbourhood is Neighbourhood.WEIGHTED else 1.0, like)


def naive_row(m: Moments, left: Array, centre: Array, right: Array, build: Build) -> Moments:
    """Sum and sum of squares of three texels, as offset and spread."""
    middle = _middle(build, centre)
    squares = (left * left + right * right) + middle * (centre * centre)
    return m._replace(offset=(left + right) + middle * centre, spread=squares)


def naive_window(m: Moments, above: Moments, centre: Moments, below: Moments, build: Build) -> Moments:
    """The mean of such rows as shift, E[x^2] - E[x]^2 as spread."""
    middle, share = _middle(build, centre.shift), share_of_one(build, centre.shift)
    total = (above.offset + below.offset) + middle * centre.offset
    squares = (above.spread + below.spread) + middle * centre.spread
    if build.choices.neighbourhood is Neighbourhood.CROSS:
        total = centre.offset + (above.shift + below.shift)
        squares = centre.spread + (above.shift * above.shift + below.shift * below.shift)
    mean = total * share
    return m._replace(shift=mean, offset=np.zeros_like(mean), spread=squares * share - mean * mean)


def chosen_row(m: Moments, left: Array, centre: Array, right: Array, build: Build) -> Moments:
    """The moments ``m`` of a row as the chosen neighbourhood and variance need them."""
    if build.choices.neighbourhood is Neighbourhood.WEIGHTED:
        m = weighted_row(m, left, centre, right)
    return naive_row(m, left, centre, right, build) if build.choices.variance is Variance.NAIVE else m


def deviation_of(m: Moments, build: Build) -> Array:
    """The root of the variance; of 0, where rounding made that less."""
    square = build.choices.neighbourhood is Neighbourhood.SQUARE
    share = constant("TWO_27THS", m.spread) if square else share_of_one(build, m.spread)
    variance = m.spread if build.choices.variance is Variance.NAIVE else m.spread * share
    deviation: Array = np.sqrt(greater(variance, number(0.0, variance)))
    return deviation


def neighbourhood_moments(above: Moments, centre: Moments, below: Moments, build: Build) -> Moments:
    """Of one channel."""
    cross = build.choices.neighbourhood is Neighbourhood.CROSS
    m = (cross_moments if cross else window_moments)(above, centre, below)
    if build.choices.neighbourhood is Neighbourhood.WEIGHTED:
        m = weighted_window(m, above, centre, below)
    if build.choices.box is Box.ROUNDED and not cross:
        m = _rounded(m, above, centre, below)
    return naive_window(m, above, centre, below, build) if build.choices.variance is Variance.NAIVE else m


def _rounded(m: Moments, above: Moments, centre: Moments, below: Moments) -> Moments:
    """``m`` with the mean of the extremes of the 3x3 and of the cross."""
    half = number(0.5, m.low)
    low = half * (m.low + lesser(lesser(above.shift, below.shift), centre.low))
    high = half * (m.high + greater(greater(above.shift, below.shift), centre.high))
    return m._replace(low=low, high=high)
