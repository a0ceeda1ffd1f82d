"""Twin of ``rectify.h``: moving implausible history into the neighbourhood's box."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cltaa.build import Build, Record
from cltaa.params import Box, Rectify
from cltaa.reference.colour import Colour, from_box_space, to_box_space
from cltaa.reference.neighbourhood import Statistics
from cltaa.reference.real import Array, constant, greater, lesser, limit, number


class BoxOf(NamedTuple):
    """Centre and half extents of the box, a channel."""

    centre: Colour
    extent: Colour


class Rectification(NamedTuple):
    """The change to the history in RGB, and how far its first coordinate was moved in half extents."""

    change: Colour
    pull: Array


def _floored(parts: list[Array], least: Array) -> Colour:
    return greater(parts[0], least), greater(parts[1], least), greater(parts[2], least)


def neighbourhood_box(s: Statistics, gamma: Array, build: Build, box_floor: Any) -> BoxOf:
    """The box of the build's kind; its extents floored where the way into it divides by them."""
    wide = [gamma * d for d in s.deviation]
    if build.choices.box is Box.VARIANCE:
        centre, extent = list(s.mean), wide
    else:
        low, high = list(s.low), list(s.high)
        if build.choices.box is Box.BOTH:
            low = [greater(m - w, lo) for m, w, lo in zip(s.mean, wide, low, strict=True)]
            high = [lesser(m + w, hi) for m, w, hi in zip(s.mean, wide, high, strict=True)]
        extent = [number(0.5, lo) * (hi - lo) for lo, hi in zip(low, high, strict=True)]
        centre = [lo + e for lo, e in zip(low, extent, strict=True)]
    box = BoxOf((centre[0], centre[1], centre[2]), (extent[0], extent[1], extent[2]))
    if build.choices.rectify in (Rectify.CLIP, Rectify.ELLIPSOID):
        size = greater(np.abs(centre[0]), greater(np.abs(centre[1]), np.abs(centre[2])))
        least = number(box_floor, size) * size + constant("TINY", size)
        box = BoxOf(box.centre, _floored(extent, least))
    return box


def _outsideness(d: list[Array], extent: Colour, build: Build) -> Array:
    a, b, c = (np.abs(distance) / e for distance, e in zip(d, extent, strict=True))
    if build.choices.rectify is Rectify.ELLIPSOID:
        return np.sqrt((a * a + b * b) + c * c)
    return greater(a, greater(b, c))


def rectify_history(history: Colour, box: BoxOf, build: Build) -> Colour:
    """The history moved into the box."""
    if build.choices.rectify is Rectify.NONE:
        return history
    if build.choices.rectify is Rectify.CLAMP:
        a, b, c = (limit(h, m - e, m + e) for h, m, e in zip(history, box.centre, box.extent, strict=True))
        return a, b, c
    d = [h - m for h, m in zip(history, box.centre, strict=True)]
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # the unguarded clip divides by flat extents, as it is known for
        t = _outsideness(d, box.extent, build)
        one = number(1.0, t)
        out = t > one
        safe = np.where(out, t, one)
        a, b, c = (np.where(out, m + k / safe, h) for h, m, k in zip(history, box.centre, d, strict=True))
    return a, b, c


def rectify(history: Colour, s: Statistics, gamma: Array, build: Build, settings: Record) -> Rectification:
    """The change that rectification makes, in RGB: history inside its box keeps its bits."""
    h = to_box_space(history, build)
    box = neighbourhood_box(s, gamma, build, settings["box_floor"])
    r = rectify_history(h, box, build)
    moved = (r[0] - h[0], r[1] - h[1], r[2] - h[2])
    least = number(settings["box_floor"], h[0]) * np.abs(box.centre[0]) + constant("TINY", h[0])
    pull = np.abs(moved[0]) / greater(box.extent[0], least)
    return Rectification(from_box_space(moved, build), pull)
