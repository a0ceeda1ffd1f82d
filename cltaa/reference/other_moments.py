"""Twin of what ``moments.h`` holds beside its own moments: the weighted 3x3, and the naive variance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cltaa.parameters.build import Build
from cltaa.parameters.choices import Neighbourhood, Variance
from cltaa.reference.real import Array, constant, number

if TYPE_CHECKING:
    from cltaa.reference.neighbourhood import Moments


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
