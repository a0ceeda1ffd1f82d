"""Twin of ``colour.h``: RGB and the box space. A colour is a tuple of three arrays [H, W]."""

from __future__ import annotations

from cltaa.parameters.build import Build
from cltaa.parameters.choices import BoxSpace, Tonemap
from cltaa.reference.real import Array, Mask, constant, greater, number, outside_domain

Colour = tuple[Array, Array, Array]


def to_box_space(v: Colour, build: Build) -> Colour:
    """RGB to Y, Co, Cg (or unchanged where the box is in RGB)."""
    if build.choices.box_space is BoxSpace.RGB:
        return v
    r, g, b = v
    quarter, half = number(0.25, r), number(0.5, r)
    rb = quarter * (r + b)
    return rb + half * g, half * (r - b), half * g - rb


def from_box_space(v: Colour, build: Build) -> Colour:
    """The inverse of ``to_box_space``."""
    if build.choices.box_space is BoxSpace.RGB:
        return v
    y, co, cg = v
    t = y - cg
    return t + co, y + cg, t - co


def luminance(v: Colour) -> Array:
    """R/4 + G/2 + B/4."""
    r, g, b = v
    y: Array = number(0.25, r) * (r + b) + number(0.5, r) * g
    return y


def peak(v: Colour) -> Array:
    """Greatest of the three and 0."""
    return greater(greater(greater(v[0], v[1]), v[2]), number(0.0, v[0]))


def to_range(v: Colour, build: Build) -> Colour:
    """Scene-referred colour in the range in which it is compared and blended."""
    if build.choices.tonemap is Tonemap.NONE:
        return v
    one = number(1.0, v[0])
    k = one / (one + peak(v))
    return v[0] * k, v[1] * k, v[2] * k


def from_range(v: Colour, build: Build) -> Colour:
    """The inverse of ``to_range``, its headroom limited."""
    if build.choices.tonemap is Tonemap.NONE:
        return v
    one = number(1.0, v[0])
    k = one / greater(one - peak(v), constant("LEAST_HEADROOM", v[0]))
    return v[0] * k, v[1] * k, v[2] * k


def colour_outside_domain(v: Colour) -> Mask:
    """True where any channel is unusable."""
    return outside_domain(v[0]) | outside_domain(v[1]) | outside_domain(v[2])
