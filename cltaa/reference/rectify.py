"""Twin of ``taa/rectify.h``: moves implausible history into the box of the current neighbourhood."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build
from cltaa.core.constants import value
from cltaa.core.parameters import Accumulate, AntiFlicker, Box, Rectify
from cltaa.reference.colour import Colour, a_channel, box_units, from_box_space, in_units, inner, to_box_space
from cltaa.reference.neighbourhood import Statistics
from cltaa.reference.real import Array, Run, greater, lesser, limit, number
from cltaa.reference.reprojection import Motion


class BoxOf(NamedTuple):
    """Centre, half extents and ends of the box by channel; unscaled ends are the 3x3's extremes, to the bit."""

    centre: Colour
    extent: Colour
    low: Colour
    high: Colour


class Rectification(NamedTuple):
    """The change to the history in RGB; boost and factor of the current sample's weight."""

    change: Colour
    blend_boost: Array
    anti_flicker_factor: Array
    alpha: Array | None = None  # of the history, rectified


def neighbourhood_box(s: Statistics, gamma: Array, run: Run) -> BoxOf:
    """The box of the build's kind; extents are floored where rectification divides by them."""
    wide = gamma * s.deviation
    if run.choices.box is Box.VARIANCE:
        if run.build.terms.luma_scale:
            wide = a_channel((float(run.settings["luma_scale"]), 1.0, 1.0)) * wide
        centre, extent, low, high = s.mean, wide, s.mean - wide, s.mean + wide
    else:
        low, high = s.low, s.high
        if run.choices.box is Box.BOTH:
            low, high = greater(s.mean - wide, low), lesser(s.mean + wide, high)
        if run.choices.box is Box.UNIT:
            low, high = lesser(low, a_channel(box_units(run.build))), greater(high, 0.0)
        extent = 0.5 * (high - low)
        centre = low + extent
        if run.choices.box is Box.EXTREMES:
            by = (0.5 * (gamma - 1.0)) * (high - low)
            low, high, extent = low - by, high + by, extent + by
    first, second, _ = units = box_units(run.build)
    if run.choices.rectify in (Rectify.CLIP, Rectify.ELLIPSOID):
        a, b, c = np.abs(centre)
        size = greater(a, greater(first / second * b, c))
        least = run.settings["box_floor"] * size + first * value("TINY")
        extent = greater(extent, a_channel([unit / first for unit in units]) * least)
    if run.choices.rectify is Rectify.CLIP_UNGUARDED:
        extent = extent + a_channel([unit * value("ADDED_EXTENT") for unit in units])
    return BoxOf(centre, extent, low, high)


def _distance_in_extents(d: Colour, extent: Colour, build: Build) -> Array:
    far = np.abs(d) / extent
    if build.choices.rectify is Rectify.ELLIPSOID:
        return np.sqrt(inner(far, far))
    return greater(far[0], greater(far[1], far[2]))


def _outside_ends(v: Colour, box: BoxOf) -> Any:
    out = (v < box.low) | (v > box.high)
    return out[0] | out[1] | out[2]


def _entry(h: Colour, direction: Colour, low: Colour, high: Colour) -> Colour:
    """Share of the way from ``h`` at which each coordinate enters the box; 0 inside."""
    parallel = direction == 0.0
    safe = np.where(parallel, 1.0, direction)
    to_low, to_high = (low - h) / safe, (high - h) / safe
    return np.where(parallel, 0.0, lesser(to_low, to_high))


def _clip_towards(history: Colour, target: Colour, box: BoxOf) -> Colour:
    direction = target - history
    a, b, c = _entry(history, direction, box.low, box.high)
    return history + limit(greater(greater(a, b), c), 0.0, 1.0) * direction


def rectify_history(history: Colour, current: Colour, box: BoxOf, build: Build) -> Colour:
    """Move the history into the box."""
    if build.choices.rectify is Rectify.NONE:
        return history
    if build.choices.rectify is Rectify.CLAMP:
        return limit(history, box.low, box.high)
    if build.choices.rectify is Rectify.CLIP_CURRENT:
        return _clip_towards(history, limit(current, box.low, box.high), box)
    d = history - box.centre
    t = _distance_in_extents(d, box.extent, build)
    out = t > 1.0
    if build.choices.rectify is Rectify.CLIP and build.choices.box is not Box.VARIANCE:
        out = out & _outside_ends(history, box)
    return np.where(out, box.centre + d / np.where(out, t, 1.0), history)


def blend_boost_of(m: Motion, moved: Colour, run: Run) -> Array:
    """0 to 1: the larger of motion in screens a frame and the distance moved in the box space; 1 in motion
    (standing)."""
    if run.choices.accumulate is Accumulate.STANDING:
        least = value("STATIC_MOTION")
        is_static = (np.abs(m.u) < least) & (np.abs(m.v) < least)
        return np.where(is_static, 0.0, np.ones_like(m.u))
    if run.choices.accumulate not in (Accumulate.ADAPTIVE, Accumulate.CAPPED):
        return np.zeros_like(m.u)
    across, down = m.u / run.layout.width, m.v / run.layout.height
    speed = np.sqrt(across * across + down * down)
    distance = np.sqrt(inner(moved, moved))
    by_motion, by_distance = (
        run.settings["motion_rate"] * speed,
        run.settings["clip_rate"] * distance,
    )
    return lesser(greater(by_motion, by_distance), 1.0)


def anti_flicker_factor_of(history: Array, centre: Array, extent: Array, build: Build) -> Array:
    """d / (d + range), d the distance of the history's first coordinate from the nearer end of the box."""
    if build.choices.anti_flicker is not AntiFlicker.CLAMP_DISTANCE:
        return np.ones_like(history)
    d = lesser(np.abs(history - (centre - extent)), np.abs(history - (centre + extent)))
    return d / ((d + (extent + extent)) + box_units(build)[0] * value("TINY"))


def rectify(history: Colour, current: Colour, s: Statistics, m: Motion, gamma: Array, run: Run) -> Rectification:
    """The change that rectification makes, in RGB: history inside its box keeps its bits."""
    choices = run.choices
    by_motion = choices.accumulate in (Accumulate.ADAPTIVE, Accumulate.CAPPED, Accumulate.STANDING)
    moves = choices.rectify is not Rectify.NONE or by_motion
    if not moves and choices.anti_flicker is not AntiFlicker.CLAMP_DISTANCE:
        zero, one = np.zeros_like(gamma), np.ones_like(gamma)
        return Rectification(np.zeros_like(history), zero, one)
    h = to_box_space(history, run.build)
    box = neighbourhood_box(s, gamma, run)
    r = rectify_history(h, to_box_space(current, run.build), box, run.build)
    moved = r - h
    return Rectification(
        from_box_space(moved, run.build),
        blend_boost_of(m, in_units(moved, run.build), run),
        anti_flicker_factor_of(h[0], box.centre[0], box.extent[0], run.build),
    )


def box_scale_of(m: Motion, run: Run) -> Array:
    """Box scale, factor of the deviations or of the extremes: wide without motion."""
    speed = greater(np.abs(m.u), np.abs(m.v)) / run.settings["motion_px"]
    still = greater(1.0 - speed, 0.0)
    moving, static = (number(run.settings[f"box_scale_{each}"], speed) for each in ("moving", "static"))
    return moving + still * (static - moving)
