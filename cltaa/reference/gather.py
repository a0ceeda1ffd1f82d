"""Twin of ``gather.h`` and ``gather.cl``: each pixel gathers the samples that the last frames drew inside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cltaa.build import Build, Record, kept_planes
from cltaa.layout import Layout
from cltaa.params import AlphaFrom, FilterUse, Reject, Weighting
from cltaa.reference.colour import Colour, colour_outside_domain, from_range, luminance, to_range
from cltaa.reference.history import same_surface
from cltaa.reference.neighbourhood import (
    Statistics,
    Surface,
    current_sample,
    nearest_surface,
    neighbourhood_statistics,
    usable_closeness,
)
from cltaa.reference.pixel import (
    Resolved,
    box_gamma,
    drawn_towards,
    filtered_share,
    fresh_colour,
    storable,
    usable_share,
)
from cltaa.reference.projection import Motion, motion_from_depth, on_screen, surface_motion
from cltaa.reference.real import Array, Mask, greater, lesser, number, outside_domain, quiet
from cltaa.reference.rectify import rectify
from cltaa.reference.resolve import load_shares, read_rows, store_resolved
from cltaa.reference.sampling import Footprint, Quad, footprint_of

KEPT_CLOSENESS, KEPT_MOTION = 3, 4


@dataclass(slots=True)
class Gathered:
    """Weighted differences of the samples from the current one; weight and number of the samples."""

    sum: list[Array]
    alpha: Array
    weight: Array
    count: Array


@dataclass(slots=True)
class Track:
    """Where surfaces that move on their own were, and which of them were lost on the way."""

    own: Mask
    u: Array
    v: Array
    lost: Mask

    def motion(self, m: Motion) -> Motion:
        """``m`` where the camera alone moves a surface, the track elsewhere."""
        one, zero = np.ones_like(m.scale), np.zeros_like(m.shift)
        return Motion(
            np.where(self.own, self.u, m.u),
            np.where(self.own, self.v, m.v),
            np.where(self.own, one, m.scale),
            np.where(self.own, zero, m.shift),
            m.visible | self.own,
        )

    def follow(self, u: Array, v: Array, seen: Mask) -> None:
        """Take the step that the sample at the surface's place tells; where it tells none the surface is lost."""
        self.lost = self.lost | (self.own & (~seen | outside_domain(u) | outside_domain(v)))
        self.u, self.v = self.u + u, self.v + v


def sample_share(v: Colour, build: Build, settings: Record) -> Array:
    """Luminance weight 1 / (knee + Y) of a sample."""
    one = number(1.0, v[0])
    if build.choices.weighting is Weighting.NONE:
        return np.full_like(v[0], one)
    share: Array = one / (number(settings["luminance_knee"], v[0]) + greater(luminance(v), number(0.0, v[0])))
    return share


def gather_samples(
    kept: Array,
    past: Any,
    frames: int,
    current: Colour,
    alpha: Array,
    s: Surface,
    build: Build,
    layout: Layout,
    settings: Record,
) -> Gathered:
    """The samples of ``frames`` kept frames [slots, planes, rows, stride], the latest first."""
    real: Any = current[0].dtype
    zero, one = np.zeros_like(current[0]), np.ones_like(current[0])
    g = Gathered([zero, zero, zero], zero, zero, zero)
    none = np.zeros(zero.shape, bool)
    own = ~(outside_domain(s.u) | outside_domain(s.v)) if build.steps.own_motion else none
    track = Track(own, s.u, s.v, none)
    for then in past[:frames]:
        planes = kept[int(then["slot"])]
        m = track.motion(motion_from_depth(s, build, layout, then)) if build.steps.own_motion else motion_from_depth(
            s, build, layout, then
        )  # fmt: skip
        seen = on_screen(m, layout) & ~track.lost
        half = number(0.5, zero)
        nearest = m._replace(
            u=m.u + (half - number(then["jitter_x"], zero)), v=m.v + (half - number(then["jitter_y"], zero))
        )
        f = footprint_of(nearest, seen, layout)
        c: Colour = (_texel(planes[0], f, real), _texel(planes[1], f, real), _texel(planes[2], f, real))
        good = seen & ~colour_outside_domain(c)
        if build.choices.reject is Reject.DEPTH:
            q = usable_closeness(_texel(planes[KEPT_CLOSENESS], f, real), then)
            good &= same_surface(Quad(q, q, q, q), s, m, settings["depth_tolerance"])
        if build.steps.exposure:
            ratio = number(then["exposure_ratio"], zero)
            c = (c[0] * ratio, c[1] * ratio, c[2] * ratio)
        c = to_range(c, build)
        c = (np.where(good, c[0], current[0]), np.where(good, c[1], current[1]), np.where(good, c[2], current[2]))
        w = np.where(good, sample_share(c, build, settings), zero)
        g.sum = [total + w * (a - b) for total, a, b in zip(g.sum, c, current, strict=True)]
        g.weight, g.count = g.weight + w, g.count + np.where(good, one, zero)
        if build.steps.alpha:
            a = usable_share(_texel(planes[kept_planes(build.steps) - 1], f, real), 1.0)
            g.alpha = g.alpha + np.where(good, a - alpha, zero)
        if build.steps.own_motion:
            there = footprint_of(nearest._replace(u=nearest.u + s.x, v=nearest.v + s.y), seen, layout)
            track.follow(_texel(planes[KEPT_MOTION], there, real), _texel(planes[KEPT_MOTION + 1], there, real), seen)
    return g


def resolve_gathered(
    g: Gathered,
    current: Colour,
    filtered: Colour,
    alpha: Array,
    reactivity: Array,
    near: Statistics,
    m: Motion,
    build: Build,
    layout: Layout,
    settings: Record,
) -> Resolved:
    """The pixel as the weighted mean of its samples, the current one among them."""
    zero, one = np.zeros_like(alpha), np.ones_like(alpha)
    any_of = g.count > zero
    weight = np.where(any_of, g.weight, one)
    r, gr, b = (x + total / weight for x, total in zip(current, g.sum, strict=True))
    past = (r, gr, b)
    change = rectify(past, current, near, m, box_gamma(m, settings), build, layout, settings).change
    share = g.weight / (sample_share(current, build, settings) + g.weight)
    alpha_share = one
    if build.steps.reactive:
        alpha_share = one - reactivity
        share = share * alpha_share
    mixed = [x + share * ((p - x) + c) for x, p, c in zip(current, past, change, strict=True)]
    fresh = fresh_colour(current, near.mean, build, settings)
    r, gr, b = (np.where(any_of, k, f) for k, f in zip(mixed, fresh, strict=True))
    chosen = (r, gr, b)
    if build.choices.filter_use is FilterUse.FEW:
        chosen = drawn_towards(chosen, filtered, filtered_share(one / (g.count + one), filtered, build, settings))
    v = from_range(chosen, build)
    stored = [storable(k, lesser(x, zero), build) for k, x in zip(v, current, strict=True)]
    if build.choices.alpha_from is AlphaFrom.BLEND:
        alpha = alpha + alpha_share * (g.alpha / (g.count + one))
    return Resolved((stored[0], stored[1], stored[2]), alpha, g.count + one)


@quiet
def gather(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    closeness: Array,
    motion: Array | None,
    alpha: Array | None,
    reactive: Array | None,
    kept: Array,
    past: Any,
    frames: int,
    output: Array,
    output_count: Array,
    frame: Record,
    settings: Record,
) -> None:
    """Resolve one frame from padded planes and ``frames`` kept ones into ``output`` and ``output_count``."""
    above, centre, below = read_rows(current, closeness, motion, build, layout, frame)
    near = neighbourhood_statistics(above, centre, below, build)
    s = nearest_surface(above, centre, below, build, settings["edge_tolerance"])
    m = surface_motion(s, build, layout, frame)
    filtered = current_sample(above, centre, below, near, build, frame)
    sample = centre.centre if build.choices.filter_use is FilterUse.FEW else filtered
    a, reactivity = load_shares(alpha, reactive, sample[0], build, layout)
    slots = kept.reshape(-1, kept_planes(build.steps), layout.rows, layout.stride)
    g = gather_samples(slots, past, frames, sample, a, s, build, layout, settings)
    store_resolved(
        resolve_gathered(g, sample, filtered, a, reactivity, near, m, build, layout, settings),
        build, layout, frame, output, output_count,
    )  # fmt: skip


def _texel(plane: Array, f: Footprint, real: Any) -> Array:
    texels: Array = plane[f.row, f.column].astype(real)
    return texels
