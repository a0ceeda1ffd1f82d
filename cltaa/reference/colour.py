"""Twin of ``colour.h``: RGB and the box space. A colour is a tuple of three arrays [H, W]."""

from __future__ import annotations

from cltaa.build import Build
from cltaa.params import BoxSpace
from cltaa.reference.real import Array, Mask, number, outside_domain

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


def colour_outside_domain(v: Colour) -> Mask:
    """True where any channel is unusable."""
    return outside_domain(v[0]) | outside_domain(v[1]) | outside_domain(v[2])
