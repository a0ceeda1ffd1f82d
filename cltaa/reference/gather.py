"""Twin of ``gather.h`` and ``gather.cl``: each pixel gathers the samples that the last frames drew inside it."""

from __future__ import annotations

from typing import Any

import numpy as np

from cltaa.build import Build, Record, kept_planes
from cltaa.layout import Layout
from cltaa.params import AlphaFrom, CurrentFilter, FilterUse, GatherFit, Weighting
from cltaa.reference.blend import filtered_share, storable_colour
from cltaa.reference.colour import Colour, colour_outside_domain, from_range, luminance, to_range
from cltaa.reference.gather_fit import Gathered, Stretch, first_sample, fit_at_centre, offset_now, stretch_of
from cltaa.reference.gather_sides import Layers, Side, layers_of, range_of_side, side_of
from cltaa.reference.gather_thin import recall_thin
from cltaa.reference.gather_track import KEPT_CLOSENESS, Track, seen_then, texel_at, untold
from cltaa.reference.neighbourhood import Surface, nearest_surface, usable_closeness
from cltaa.reference.pixel import (
    Pixel,
    Resolved,
    box_gamma,
    current_pixel,
    drawn_towards,
    fresh_colour,
    usable_share,
)
from cltaa.reference.planes import read_rows, store_resolved
from cltaa.reference.projection import Motion, motion_from_depth, on_screen, surface_motion
from cltaa.reference.real import Array, greater, limit, number, quiet
from cltaa.reference.rectify import rectify
from cltaa.reference.sampling import Footprint, footprint_of


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
    g: Gathered,
    now: Pixel,
    s: Surface,
    layers: Layers,
    build: Build,
    layout: Layout,
    frame: Record,
    settings: Record,
    *,
    far_only: bool = False,
) -> Gathered:
    """``g`` and the samples of ``now`` on ``s`` in the kept frames [slots, planes, rows, stride] of ``past``, latest
    first."""
    current = now.own
    zero, one = np.zeros_like(current[0]), np.ones_like(current[0])
    none = np.zeros(zero.shape, bool)
    fit, own_motion = build.choices.gather_fit, build.steps.own_motion
    followed = range_of_side(s, layers, far=far_only) if fit is GatherFit.LAYERS else s
    track = Track(~untold(s.u, s.v) if own_motion else none, s.u, s.v, zero, none)
    for then in past:
        planes = kept[int(then["slot"])]
        m, stretch = _way_back(track, s, layers, build, layout, frame, then)
        seen = on_screen(m, layout) & ~track.lost
        half = number(0.5, zero)
        nearest = m._replace(
            u=m.u + (half - number(then["jitter_x"], zero)), v=m.v + (half - number(then["jitter_y"], zero))
        )
        f = footprint_of(nearest, seen, layout)
        c, q = _sample(planes, f, zero, then)
        good = seen & ~colour_outside_domain(c)
        good = good & seen_then(q, s, m, build, settings)
        dx, dy, near = half - f.fx, half - f.fy, ~none
        if fit is not GatherFit.MEAN:
            dx, dy, visible = offset_now(dx, dy, stretch)
            good = good & visible & (greater(np.abs(dx), np.abs(dy)) <= number(settings["fit_reach"], zero))
            near = ~layers.edge | (q > layers.cut * m.scale + m.shift)
            good = good & ~near if far_only else good
        if build.steps.exposure:
            ratio = number(then["exposure_ratio"], zero)
            c = (c[0] * ratio, c[1] * ratio, c[2] * ratio)
        c = to_range(c, build)
        c = (np.where(good, c[0], current[0]), np.where(good, c[1], current[1]), np.where(good, c[2], current[2]))
        d = [a - b for a, b in zip(c, current, strict=True)]
        w = np.where(good, sample_share(c, build, settings), zero)
        g.add(d, w, np.where(good, dx, zero), np.where(good, dy, zero), ~near if far_only else near, fit)
        g.count = g.count + np.where(good, one, zero)
        if build.steps.alpha:
            a = usable_share(texel_at(planes[kept_planes(build.steps) - 1], f, zero.dtype), 1.0)
            g.alpha = g.alpha + np.where(good, a - now.alpha, zero)
        if own_motion:
            there = footprint_of(nearest._replace(u=nearest.u + s.x, v=nearest.v + s.y), seen, layout)
            track.follow(followed, m, planes, there, seen, build, then, settings)
    return g


def _way_back(
    track: Track, s: Surface, layers: Layers, build: Build, layout: Layout, frame: Record, then: Record
) -> tuple[Motion, Stretch]:
    """The motion of the pixel's centre to a kept frame, and how pixels are stretched on the way."""
    zero = np.zeros_like(s.centre)
    m = motion_from_depth(s, build, layout, then)
    stretch = Stretch(zero, zero, zero, zero)
    if build.choices.gather_fit is not GatherFit.MEAN:
        stretch = stretch_of(s, layers.slope, m, build, layout, then)
        ox, oy = s.x + number(frame["jitter_x"], zero), s.y + number(frame["jitter_y"], zero)
        m = m._replace(u=m.u - (stretch.xx * ox + stretch.xy * oy), v=m.v - (stretch.yx * ox + stretch.yy * oy))
    if build.steps.own_motion:
        m = track.motion(m)
        stretch = Stretch(*(np.where(track.own, zero, part) for part in stretch))
    return m, stretch


def _sample(planes: Array, f: Footprint, like: Array, then: Record) -> tuple[Colour, Array]:
    r, g, b = (texel_at(planes[channel], f, like.dtype) for channel in range(3))
    return (r, g, b), usable_closeness(texel_at(planes[KEPT_CLOSENESS], f, like.dtype), then)


def add_side(g: Gathered, side: Side, current: Colour, build: Build, settings: Record) -> None:
    """What the current frame shows of a side around the pixel, as one sample."""
    zero = np.zeros_like(side.count)
    some = side.count > zero
    d = [a - b for a, b in zip(side.mean, current, strict=True)]
    w = np.where(some, sample_share(side.mean, build, settings), zero)
    g.add(d, w, zero, zero, some, build.choices.gather_fit)


def gathered_change(g: Gathered, far: Gathered, layers: Layers, build: Build, settings: Record) -> list[Array]:
    """What the samples of a pixel come to, less the current one."""
    zero, one = np.zeros_like(g.count), np.ones_like(g.count)
    f = fit_at_centre(g, g.count + one, settings)
    v = [f.value(*sums) for sums in zip(g.sum, g.along, g.down, strict=True)]
    if build.choices.gather_fit is GatherFit.LAYERS:
        seen = one - limit(f.value(g.near, g.near_x, g.near_y), zero, one)
        any_of = far.weight > zero
        instead = np.where(any_of, far.weight, np.where(g.near > zero, g.near, one))
        mean = np.where(layers.edge, seen, zero) / instead
        v = [k + mean * np.where(any_of, a, b) for k, a, b in zip(v, far.sum, g.sum, strict=True)]
    return v


def resolve_gathered(
    g: Gathered,
    far: Gathered,
    layers: Layers,
    p: Pixel,
    m: Motion,
    build: Build,
    layout: Layout,
    settings: Record,
) -> Resolved:
    """The pixel from its samples, the current one among them."""
    current, alpha = p.own, p.alpha
    zero, one = np.zeros_like(alpha), np.ones_like(alpha)
    any_of = g.count > zero
    weight = np.where(any_of, g.weight, one)
    plain = build.choices.gather_fit is GatherFit.MEAN
    change = [total / weight for total in g.sum] if plain else gathered_change(g, far, layers, build, settings)
    past = (current[0] + change[0], current[1] + change[1], current[2] + change[2])
    moved = rectify(past, current, p.near, m, box_gamma(m, settings), build, layout, settings).change
    share = g.weight / (sample_share(current, build, settings) + g.weight) if plain else one
    alpha_share = one
    if build.steps.reactive:
        alpha_share = one - p.reactivity
        share = share * alpha_share
    mixed = [x + share * ((y - x) + c) for x, y, c in zip(current, past, moved, strict=True)]
    fresh = fresh_colour(current, p.near.mean, build, settings)
    r, gr, b = (np.where(any_of, k, f) for k, f in zip(mixed, fresh, strict=True))
    chosen = (r, gr, b)
    filters = build.choices.current_filter is not CurrentFilter.NONE
    if filters and build.choices.filter_use is FilterUse.FEW:
        share = filtered_share(one / (g.count + one), p.filtered, build, settings)
        chosen = drawn_towards(chosen, p.filtered, share)
    stored = storable_colour(from_range(chosen, build), current, build)
    if build.choices.alpha_from is AlphaFrom.BLEND:
        alpha = alpha + alpha_share * (g.alpha / (g.count + one))
    return Resolved(stored, alpha, g.count + one)


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
    rows = read_rows(current, closeness, motion, build, layout, frame)
    p = current_pixel(rows, alpha, reactive, build, layout, frame)
    s = nearest_surface(*rows, build, settings["edge_tolerance"])
    m = surface_motion(s, build, layout, frame)
    slots = kept.reshape(-1, kept_planes(build.steps), layout.rows, layout.stride)
    layers = layers_of(*rows, s, settings)
    told = past[:frames]
    if build.choices.gather_fit is GatherFit.LAYERS:
        s, layers = recall_thin(s, layers, slots, told, build, layout, settings)
    near_one = ~layers.edge | (s.centre > layers.cut)
    w = sample_share(p.own, build, settings)
    g = first_sample(w, near_one | ~near_one, near_one, build, frame)
    far = first_sample(w, ~near_one, ~near_one, build, frame)
    of_sides = (s, layers, p.own, current, closeness, motion, build, layout, frame, settings)
    if build.choices.gather_fit is GatherFit.LAYERS:
        front, back = side_of(*of_sides, far=False), side_of(*of_sides, far=True)
        g = gather_samples(slots, told, g, p, front.surface, front.layers, build, layout, frame, settings)
        add_side(far, back, p.own, build, settings)
        far = gather_samples(
            slots, told, far, p, back.surface, back.layers, build, layout, frame, settings, far_only=True
        )
    else:
        g = gather_samples(slots, told, g, p, s, layers, build, layout, frame, settings)
    resolved = resolve_gathered(g, far, layers, p, m, build, layout, settings)
    store_resolved(resolved, build, layout, frame, output, output_count)
