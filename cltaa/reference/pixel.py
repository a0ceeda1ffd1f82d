"""Twin of ``pixel.h``: one output pixel from its current sample, its neighbourhood and its history."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cltaa.constants import PAD_X, PAD_Y
from cltaa.memory.layout import Layout
from cltaa.parameters.build import Build, Record
from cltaa.parameters.choices import AlphaFrom, AntiFlicker, Box, FilterUse, LightChange
from cltaa.reference.blend import (
    believed_count,
    blend,
    difference_share,
    filtered_share,
    most_samples,
    storable_colour,
    weight_of_sample,
)
from cltaa.reference.colour import Colour, from_box_space, from_range, to_box_space
from cltaa.reference.history import History
from cltaa.reference.light import with_change_of
from cltaa.reference.neighbourhood import Row, Statistics, current_sample, neighbourhood_statistics
from cltaa.reference.projection import Motion
from cltaa.reference.real import Array, constant, greater, lesser, limit, number, outside_domain
from cltaa.reference.rectify import Rectification


class Pixel(NamedTuple):
    """What the current frame says of each pixel; ``own`` is its sample, ``filtered`` what the current filter makes of
    it, which takes the place of ``own`` but where ``filter_use`` says few-samples."""

    own: Colour
    filtered: Colour
    alpha: Array
    reactivity: Array
    near: Statistics
    least_reactive: Array  # of the 3x3, where spans of the past are weighed
    most_reactive: Array


@dataclass(frozen=True, slots=True)
class Resolved:
    """What one frame leaves at each pixel."""

    rgb: Colour
    alpha: Array
    count: Array


def usable_share(v: Array, otherwise: float) -> Array:
    """Alpha or reactivity limited to [0, 1]; no number means ``otherwise``."""
    return np.where(outside_domain(v), number(otherwise, v), limit(v, number(0, v), number(1, v)))


def load_shares(
    alpha: Array | None, reactive: Array | None, like: Array, build: Build, layout: Layout
) -> tuple[Array, Array]:
    """Alpha and reactivity of each pixel from padded planes [1, rows, stride]; 1 and 0 where a build has none."""
    one, zero = np.ones_like(like), np.zeros_like(like)
    steps = build.steps
    return (
        usable_share(layout.inside(alpha)[0].astype(like.dtype), 1.0) if steps.alpha and alpha is not None else one,
        usable_share(layout.inside(reactive)[0].astype(like.dtype), 0.0)
        if steps.reactive and reactive is not None
        else zero,
    )


def current_pixel(
    rows: tuple[Row, Row, Row],
    alpha: Array | None,
    reactive: Array | None,
    build: Build,
    layout: Layout,
    frame: Record,
) -> Pixel:
    """Each pixel from the rows above, at and below it, and from padded planes [1, rows, stride] of shares."""
    near = neighbourhood_statistics(*rows, build)
    filtered = current_sample(*rows, near, build, frame)
    own = rows[1].centre if build.choices.filter_use is FilterUse.FEW else filtered
    shares = load_shares(alpha, reactive, own[0], build, layout)
    least = most = shares[1]
    if build.steps.reactive and reactive is not None and build.choices.light_change is LightChange.SPANS:
        for top in (PAD_Y - 1, PAD_Y, PAD_Y + 1):
            for left in (PAD_X - 1, PAD_X, PAD_X + 1):
                there = reactive[0, top : top + layout.height, left : left + layout.width].astype(least.dtype)
                r = usable_share(there, 0.0)
                least, most = lesser(least, r), greater(most, r)
    return Pixel(own, filtered, *shares, near, least, most)


def as_reactive(r: Array, now: Pixel) -> Array:
    """How much counts of samples [H, W] that were drawn with reactivity ``r``."""
    off = greater(greater(now.least_reactive - r, r - now.most_reactive), np.zeros_like(r))
    far = off * constant("REACTIVE_FALL", r)
    result: Array = greater(number(1.0, r) - far * far, np.zeros_like(r))
    return result


def box_gamma(m: Motion, settings: Record) -> Array:
    """Half width of the box in standard deviations: wide where nothing moves."""
    k = m.u.dtype.type
    speed = greater(np.abs(m.u), np.abs(m.v)) / k(settings["motion_px"])
    still = greater(k(1.0) - speed, k(0.0))
    result: Array = k(settings["gamma_moving"]) + still * (k(settings["gamma_still"]) - k(settings["gamma_moving"]))
    return result


def past_alpha(plane: Array, past: Array, build: Build, layout: Layout) -> Array:
    """The history's alpha; where the box is ``unit``, held in the extremes of the current 3x3 of ``plane``."""
    if build.choices.box is not Box.UNIT:
        return past
    share = usable_share(plane[0].astype(past.dtype), 1.0)
    low, high = np.ones_like(past), np.zeros_like(past)
    for top in (PAD_Y - 1, PAD_Y, PAD_Y + 1):
        for left in (PAD_X - 1, PAD_X, PAD_X + 1):
            a = share[top : top + layout.height, left : left + layout.width]
            low, high = lesser(a, low), greater(a, high)
    return limit(past, low, high)


def fresh_colour(current: Colour, mean: Colour, build: Build, settings: Record) -> Colour:
    """The sample of a pixel without history, drawn towards the mean of its neighbourhood."""
    c = to_box_space(current, build)
    change = from_box_space((mean[0] - c[0], mean[1] - c[1], mean[2] - c[2]), build)
    blur = number(settings["fresh_blur"], c[0])
    r, g, b = (k + blur * by for k, by in zip(current, change, strict=True))
    return r, g, b


def drawn_towards(own: Colour, filtered: Colour, share: Array) -> Colour:
    """``own`` drawn towards ``filtered`` by a share."""
    r, g, b = (c + share * (f - c) for c, f in zip(own, filtered, strict=True))
    return r, g, b


def believed_samples(p: Pixel, h: History, r: Rectification, build: Build, settings: Record) -> Array:
    """How many samples a pixel's rectified history is believed to stand for."""
    most = most_samples(h.fx, h.fy, build, settings)
    count = believed_count(np.abs(h.count), most, r.pull, build, settings)
    return count * (number(1.0, count) - p.reactivity) if build.steps.reactive else count


def fading_share(of_mean: Array, settings: Record) -> Array:
    """Share of the filtered sample in the n-th of a history: 1 / n, ``of_mean``, but as 1 / n^2 from some n on."""
    return lesser(of_mean, number(settings["filter_samples"], of_mean) * (of_mean * of_mean))


def resolve_pixel(p: Pixel, h: History, r: Rectification, build: Build, settings: Record) -> Resolved:
    """The pixel blended with its rectified history, or begun anew where there is none."""
    return resolve_beside(p, h, r, believed_samples(p, h, r, build, settings), build, settings)


def resolve_beside(p: Pixel, h: History, r: Rectification, count: Array, build: Build, settings: Record) -> Resolved:
    """The pixel blended with its rectified history of ``count`` samples, or begun anew where there is none."""
    current = p.filtered
    one = number(1.0, h.count)
    past = (h.rgb[0] + r.change[0], h.rgb[1] + r.change[1], h.rgb[2] + r.change[2])
    if build.choices.filter_use is FilterUse.FEW:
        share = np.where(h.valid, fading_share(one / (count + one), settings), one)
        current = drawn_towards(p.own, current, filtered_share(share, current, build, settings))
    weight = weight_of_sample(count, current, past, p.reactivity, r.unrest, build, settings)
    if build.choices.anti_flicker is AntiFlicker.DIFFERENCE:
        weight = weight * difference_share(current, past, settings)
    if build.choices.anti_flicker is AntiFlicker.CLAMP_DISTANCE:
        weight = weight * r.calm
    fresh = fresh_colour(current, p.near.mean, build, settings)
    mixed = [blend(y, c, weight) for y, c in zip(past, current, strict=True)]
    chosen = [np.where(h.valid, m, f) for m, f in zip(mixed, fresh, strict=True)]
    stored = storable_colour(from_range((chosen[0], chosen[1], chosen[2]), build), current, build)
    alpha = p.alpha
    if build.choices.alpha_from is AlphaFrom.BLEND:
        alpha = np.where(h.valid, blend(h.alpha, alpha, weight), alpha)
    samples = np.where(h.valid, count + one, one)
    if build.choices.light_change is not LightChange.IGNORE:
        samples = np.where(h.valid, with_change_of(samples, h.count), samples)
    return Resolved(stored, alpha, samples)
