"""Twin of ``span_now.h``: what the current frame says of what the spans of each pixel's past came to."""

from __future__ import annotations

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.constants import CONSTANTS
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import sample_share
from cltaa.reference.colour import Colour, colour_outside_domain
from cltaa.reference.real import (
    Array,
    constant,
    greater,
    lesser,
    limit,
    number,
)
from cltaa.reference.span_weights import Drift, around

TEXELS = 9


def now_drift(said: list[Array], now: list[Array], weights: list[Array], weight: Array) -> Drift:
    """How far the texels [H, W] of a 3x3 of now lie from what the spans say there, in one channel: their mean, its
    variance, and the mean light."""
    total = level = squares = np.zeros_like(weight)
    for v, c, w in zip(said, now, weights, strict=True):
        total, level = total + w * (c - v), level + w * np.abs(v)
    mean = total / weight
    for v, c, w in zip(said, now, weights, strict=True):
        off = (c - v) - mean
        squares = squares + w * (off * off)
    return Drift(mean, squares / (weight * number(TEXELS - 1, weight)), level / weight)


def no_chance(difference: Array, drift: Drift, said: list[Array], shared: Array, frame: Record) -> Array:
    """What is left of a difference [H, W] from now without what chance and a slope seen by jitter may have made."""
    along = down = zero = np.zeros_like(shared)
    for k, v in enumerate(said):
        along, down = along + number(k % 3 - 1, zero) * v, down + number(k // 3 - 1, zero) * v
    jitter_x, jitter_y = number(frame["jitter_x"], zero), number(frame["jitter_y"], zero)
    by_jitter = (along * jitter_x + down * jitter_y) * number(1 / 6, zero)
    of_level = constant("NOW_FLOOR", zero) * drift.level
    noise = constant("NOW_T", zero) * (np.sqrt(drift.variance + shared) + of_level)
    result: Array = difference - limit(difference, lesser(by_jitter, zero) - noise, greater(by_jitter, zero) + noise)
    return result


def said_around(spans: list[Array], shares: list[Array], layout: Layout) -> list[Colour]:
    """What spans, padded planes [3, rows, stride] each, say of each texel of the 3x3 by what each counts in the middle
    of it; all but the first have a share."""
    near = [[list(around(plane, layout, 1)) for plane in span] for span in spans]
    said = []
    for k in range(TEXELS):
        first = [plane[k] for plane in near[0]]
        v = first
        for span, share in zip(near[1:], shares, strict=True):
            v = [total + share * (plane[k] - begin) for total, plane, begin in zip(v, span, first, strict=True)]
        said.append((v[0], v[1], v[2]))
    return said


def moved_to_now(
    v: Colour,
    spans: list[Array],
    shares: list[Array],
    current: Array,
    build: Build,
    layout: Layout,
    frame: Record,
    settings: Record,
) -> Colour:
    """``v``, what the spans came to, moved to what the 3x3 of ``current`` [3, rows, stride] shows, as far as that is no
    chance."""
    zero, one = np.zeros_like(v[0]), np.ones_like(v[0])
    said = said_around(spans, shares, layout)
    drawn, weights, weight = [], [], zero
    for s, c in zip(said, zip(*(around(plane, layout, 1) for plane in current), strict=True), strict=True):
        good = ~colour_outside_domain(c)
        n = (np.where(good, c[0], s[0]), np.where(good, c[1], s[1]), np.where(good, c[2], s[2]))
        shared = sample_share(s, build, settings) * sample_share(n, build, settings)
        weights.append(np.where(good, shared, zero))
        weight = weight + weights[-1]
        drawn.append(n)
    some = weight > zero
    weight = np.where(some, weight, one)
    channels = [([s[i] for s in said], [n[i] for n in drawn]) for i in range(3)]
    d = [now_drift(was, now, weights, weight) for was, now in channels]
    of_each = number(CONSTANTS["NOW_SHARED"].value * (TEXELS - 1) / 3.0, zero)
    noise = ((d[0].variance + d[1].variance) + d[2].variance) * of_each
    there = [
        k + no_chance(drift.mean - (k - was[TEXELS // 2]), drift, was, noise, frame)
        for k, drift, (was, _) in zip(v, d, channels, strict=True)
    ]
    r, g, b = (np.where(some, k, own) for k, own in zip(there, v, strict=True))
    return r, g, b


def held_by_now(v: Colour, current: Array, layout: Layout) -> Colour:
    """``v`` as far as the 5x5 of ``current`` [3, rows, stride] can hold it."""
    low, high = list(v), list(v)
    for k, c in enumerate(zip(*(around(plane, layout) for plane in current), strict=True)):
        good = ~colour_outside_domain(c)
        n = [np.where(good, drawn, own) for drawn, own in zip(c, v, strict=True)]
        low = [lesser(a, b) for a, b in zip(low, n, strict=True)] if k else n
        high = [greater(a, b) for a, b in zip(high, n, strict=True)] if k else n
    wide = [constant("NOW_HELD", a) * (b - a) for a, b in zip(low, high, strict=True)]
    held = [limit(x, a - w, b + w) for x, a, b, w in zip(v, low, high, wide, strict=True)]
    return held[0], held[1], held[2]
