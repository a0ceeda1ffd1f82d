"""Twin of ``taa/rectify.h``: history that the current neighbourhood makes implausible, moved into its box."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.parameters import Accumulate, AntiFlicker, Box, Rectify
from cltaa.core.planes import Layout
from cltaa.reference.colour import Colour, from_box_space, to_box_space
from cltaa.reference.neighbourhood import Statistics
from cltaa.reference.real import Array, constant, greater, lesser, limit, number
from cltaa.reference.reprojection import Motion


class BoxOf(NamedTuple):
    """Centre, half extents and ends of the box, a channel; unscaled ends are the 3x3's extremes, to the bit."""

    centre: Colour
    extent: Colour
    low: Colour
    high: Colour


class Rectification(NamedTuple):
    """The change to the history in RGB; how far its first coordinate was moved, in half extents; boost and factor of
    the current sample's weight."""

    change: Colour
    clip_distance: Array
    blend_boost: Array
    anti_flicker_factor: Array


def _three(parts: list[Array]) -> Colour:
    return parts[0], parts[1], parts[2]


def neighbourhood_box(s: Statistics, gamma: Array, build: Build, settings: Record) -> BoxOf:
    """The box of the build's kind; its extents floored where the way into it divides by them."""
    wide = [gamma * d for d in s.deviation]
    if build.choices.box is Box.VARIANCE:
        if build.terms.luma_scale:
            wide[0] = wide[0] * number(settings["luma_scale"], wide[0])
        centre, extent = list(s.mean), wide
        low, high = (
            [m - w for m, w in zip(s.mean, wide, strict=True)],
            [m + w for m, w in zip(s.mean, wide, strict=True)],
        )
    else:
        low, high = list(s.low), list(s.high)
        if build.choices.box is Box.BOTH:
            low = [greater(m - w, lo) for m, w, lo in zip(s.mean, wide, low, strict=True)]
            high = [lesser(m + w, hi) for m, w, hi in zip(s.mean, wide, high, strict=True)]
        if build.choices.box is Box.UNIT:
            low = [lesser(lo, number(1.0, lo)) for lo in low]
            high = [greater(hi, number(0.0, hi)) for hi in high]
        extent = [number(0.5, lo) * (hi - lo) for lo, hi in zip(low, high, strict=True)]
        centre = [lo + e for lo, e in zip(low, extent, strict=True)]
        if build.choices.box is Box.EXTREMES:
            by = [(gamma - number(1.0, gamma)) * e for e in extent]
            low = [lo - b for lo, b in zip(low, by, strict=True)]
            high = [hi + b for hi, b in zip(high, by, strict=True)]
            extent = [e + b for e, b in zip(extent, by, strict=True)]
    box = BoxOf(_three(centre), _three(extent), _three(low), _three(high))
    if build.choices.rectify in (Rectify.CLIP, Rectify.ELLIPSOID):
        size = greater(np.abs(centre[0]), greater(np.abs(centre[1]), np.abs(centre[2])))
        least = number(settings["box_floor"], size) * size + constant("TINY", size)
        box = box._replace(extent=_three([greater(e, least) for e in extent]))
    if build.choices.rectify is Rectify.CLIP_UNGUARDED:
        box = box._replace(extent=_three([e + constant("ADDED_EXTENT", e) for e in extent]))
    return box


def _outsideness(d: list[Array], extent: Colour, build: Build) -> Array:
    a, b, c = (np.abs(distance) / e for distance, e in zip(d, extent, strict=True))
    if build.choices.rectify is Rectify.ELLIPSOID:
        return np.sqrt((a * a + b * b) + c * c)
    return greater(a, greater(b, c))


def _outside_ends(v: Colour, box: BoxOf) -> Any:
    a, b, c = ((k < low) | (k > high) for k, low, high in zip(v, box.low, box.high, strict=True))
    return a | b | c


def _entry(h: Array, way: Array, low: Array, high: Array) -> Array:
    """Share of the way from ``h`` at which one coordinate enters the box; 0 inside."""
    still = way == number(0.0, way)
    safe = np.where(still, number(1.0, way), way)
    to_low, to_high = (low - h) / safe, (high - h) / safe
    return np.where(still, number(0.0, way), lesser(to_low, to_high))


def _clamp_to_box(v: Colour, box: BoxOf) -> Colour:
    a, b, c = (limit(h, low, high) for h, low, high in zip(v, box.low, box.high, strict=True))
    return a, b, c


def _clip_towards(history: Colour, target: Colour, box: BoxOf) -> Colour:
    way = [t - h for t, h in zip(target, history, strict=True)]
    a, b, c = (_entry(*parts) for parts in zip(history, way, box.low, box.high, strict=True))
    t = limit(greater(greater(a, b), c), number(0.0, a), number(1.0, a))
    a, b, c = (h + t * w for h, w in zip(history, way, strict=True))
    return a, b, c


def rectify_history(history: Colour, current: Colour, box: BoxOf, build: Build) -> Colour:
    """The history moved into the box."""
    if build.choices.rectify is Rectify.NONE:
        return history
    if build.choices.rectify is Rectify.CLAMP:
        return _clamp_to_box(history, box)
    if build.choices.rectify is Rectify.CLIP_CURRENT:
        return _clip_towards(history, _clamp_to_box(current, box), box)
    d = [h - m for h, m in zip(history, box.centre, strict=True)]
    t = _outsideness(d, box.extent, build)
    one = number(1.0, t)
    out = t > one
    if build.choices.rectify is Rectify.CLIP and build.choices.box is not Box.VARIANCE:
        out = out & _outside_ends(history, box)
    safe = np.where(out, t, one)
    a, b, c = (np.where(out, m + k / safe, h) for h, m, k in zip(history, box.centre, d, strict=True))
    return a, b, c


def blend_boost_of(m: Motion, moved: list[Array], build: Build, layout: Layout, settings: Record) -> Array:
    """The larger of two shares: motion in screens a frame, and the distance that the history was moved."""
    if build.choices.accumulate is Accumulate.STANDING:
        least = constant("STANDS", m.u)
        stands = (np.abs(m.u) < least) & (np.abs(m.v) < least)
        return np.where(stands, np.zeros_like(m.u), np.ones_like(m.u))
    if build.choices.accumulate not in (Accumulate.ADAPTIVE, Accumulate.CAPPED):
        return np.zeros_like(m.u)
    across, down = m.u / number(layout.width, m.u), m.v / number(layout.height, m.v)
    speed = np.sqrt(across * across + down * down)
    distance = np.sqrt((moved[0] * moved[0] + moved[1] * moved[1]) + moved[2] * moved[2])
    by_motion, by_distance = (
        number(settings["motion_rate"], speed) * speed,
        number(settings["clip_rate"], speed) * distance,
    )
    return lesser(greater(by_motion, by_distance), number(1.0, speed))


def anti_flicker_factor_of(history: Array, centre: Array, extent: Array, build: Build) -> Array:
    """d / (d + range), d the distance of the history's first coordinate from the nearer end of the box."""
    if build.choices.anti_flicker is not AntiFlicker.CLAMP_DISTANCE:
        return np.ones_like(history)
    d = lesser(np.abs(history - (centre - extent)), np.abs(history - (centre + extent)))
    anti_flicker_factor: Array = d / ((d + (extent + extent)) + constant("TINY", d))
    return anti_flicker_factor


def rectify(
    history: Colour,
    current: Colour,
    s: Statistics,
    m: Motion,
    gamma: Array,
    build: Build,
    layout: Layout,
    settings: Record,
) -> Rectification:
    """The change that rectification makes, in RGB: history inside its box keeps its bits."""
    choices = build.choices
    by_motion = choices.accumulate in (Accumulate.ADAPTIVE, Accumulate.CAPPED, Accumulate.STANDING)
    moves = choices.rectify is not Rectify.NONE or by_motion
    if not moves and choices.anti_flicker is not AntiFlicker.CLAMP_DISTANCE:
        zero, one = np.zeros_like(gamma), np.ones_like(gamma)
        return Rectification((zero, zero, zero), zero, zero, one)
    h = to_box_space(history, build)
    box = neighbourhood_box(s, gamma, build, settings)
    r = rectify_history(h, to_box_space(current, build), box, build)
    moved = [after - before for after, before in zip(r, h, strict=True)]
    least = number(settings["box_floor"], h[0]) * np.abs(box.centre[0]) + constant("TINY", h[0])
    return Rectification(
        from_box_space((moved[0], moved[1], moved[2]), build),
        np.abs(moved[0]) / greater(box.extent[0], least),
        blend_boost_of(m, moved, build, layout, settings),
        anti_flicker_factor_of(h[0], box.centre[0], box.extent[0], build),
    )


def box_scale_of(m: Motion, settings: Record) -> Array:
    """Scale of the box, of its deviations or of its extremes: wide where nothing moves."""
    k = m.u.dtype.type
    speed = greater(np.abs(m.u), np.abs(m.v)) / k(settings["motion_px"])
    still = greater(k(1.0) - speed, k(0.0))
    result: Array = k(settings["box_scale_moving"]) + still * (
        k(settings["box_scale_static"]) - k(settings["box_scale_moving"])
    )
    return result
