"""Twin of ``gather.h`` and ``gather.cl``: each pixel gathers the samples that the last frames drew inside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cltaa.core.build import Build, Record, ring_planes
from cltaa.core.parameters import AlphaFrom, CurrentFilter, FilterUse, GatherFit, Illumination
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import (
    Pixel,
    Resolved,
    box_scale_of,
    current_pixel,
    disoccluded_colour,
    drawn_towards,
    fading_share,
    filtered_share,
    sample_share,
    storable_colour,
)
from cltaa.reference.colour import Colour, from_range
from cltaa.reference.gather_samples import (
    Gathered,
    Stretch,
    View,
    first_sample,
    fit_at_centre,
    gather_sample,
    places_now,
    reach_of,
    stretch_of,
)
from cltaa.reference.gather_surfaces import (
    NEIGHBOURS,
    Layers,
    Side,
    Track,
    find_subpixel_feature,
    layers_of,
    range_of_side,
    side_of,
)
from cltaa.reference.neighbourhood import Surface, nearest_surface
from cltaa.reference.planes import extend_stored, read_rows, store_resolved
from cltaa.reference.real import (
    Array,
    Mask,
    greater,
    limit,
    number,
    quiet,
)
from cltaa.reference.rectify import rectify
from cltaa.reference.reprojection import Motion, motion_from_depth, on_screen, pixel_grid, surface_motion
from cltaa.reference.sampling import footprint_of


def gather_samples(
    ring: Array,
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
    track: Track | None = None,
    before: int = 0,
    recent: int = 0,
) -> Gathered:
    """``g`` and the samples of ``now`` on ``s`` in the frames in the ring [slots, planes, rows, stride] of ``past``,
    latest first.

    ``track`` is where own motion had led in the ``before`` frames before them, and is led on; samples of the first
    ``recent`` frames are summed on their own too.
    """
    zero = np.zeros_like(now.own[0])
    fit, own_motion = build.choices.gather_fit, build.steps.own_motion
    followed = range_of_side(s, layers, far=far_only) if fit is GatherFit.LAYERS else s
    track = track or Track.of(s, build)
    steps = [(0, 0)] if fit is GatherFit.MEAN else NEIGHBOURS
    reach = reach_of(before + len(past) + 1, settings, zero)
    for k, then in enumerate(past):
        m, stretch = _way_back(track, s, layers, build, layout, frame, then)
        nearest, v = _view(ring[int(then["slot"])], m, on_screen(m, layout) & ~track.lost, stretch, reach, layout, then)
        v = v._replace(recent=k < recent)
        for right, down in steps:
            gather_sample(g, v, right, down, now, s, layers, build, layout, settings, far_only=far_only)
        if own_motion:
            there = footprint_of(nearest._replace(u=nearest.u + s.x, v=nearest.v + s.y), v.seen, layout)
            track.follow(followed, m, v.planes, there, v.seen, build, then, settings)
    return g


def _view(
    planes: Array, m: Motion, seen: Mask, stretch: Stretch, reach: Array, layout: Layout, then: Record
) -> tuple[Motion, View]:
    """The way to the texels whose samples lie nearest, and the frame seen from there."""
    half = number(0.5, m.u)
    u, v = m.u + (half - number(then["jitter_x"], m.u)), m.v + (half - number(then["jitter_y"], m.u))
    nearest = m._replace(u=u, v=v)
    f = footprint_of(nearest, seen, layout)
    x, y = pixel_grid(layout, m.u)
    places = places_now(half - f.fx, half - f.fy, stretch)
    return nearest, View(planes, then, m, seen, f, (x + u) - f.fx, (y + v) - f.fy, places, reach)


def _way_back(
    track: Track, s: Surface, layers: Layers, build: Build, layout: Layout, frame: Record, then: Record
) -> tuple[Motion, Stretch]:
    """The motion of the pixel's centre to a frame of the ring, and how pixels are stretched on the way."""
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


def gathered_filter_share(of_mean: Array, g: Gathered, layers: Layers, build: Build, settings: Record) -> Array:
    """Share of the filtered sample beside the n of a pixel, from their share 1 / n, ``of_mean``."""
    if build.choices.illumination is Illumination.WINDOW:
        return np.where(layers.edge, of_mean, fading_share(of_mean, settings))
    one = np.ones_like(of_mean)
    n = g.count + one
    return np.where(layers.edge, of_mean, one / greater(n * n - one, one))


def distrust(reactivity: Array, build: Build) -> Array:
    """How much of its samples a reactive pixel [H, W] gives up for the current one."""
    square: Array = reactivity * reactivity
    return square * square if build.choices.illumination is Illumination.WINDOW else reactivity


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
    moved = rectify(past, current, p.near, m, box_scale_of(m, settings), build, layout, settings).change
    share = g.weight / (sample_share(current, build, settings) + g.weight) if plain else one
    alpha_share = one
    if build.steps.reactive:
        alpha_share = one - distrust(p.reactivity, build)
        share = share * alpha_share
    mixed = [x + share * ((y - x) + c) for x, y, c in zip(current, past, moved, strict=True)]
    fresh = disoccluded_colour(current, p.near.mean, build, settings)
    r, gr, b = (np.where(any_of, k, f) for k, f in zip(mixed, fresh, strict=True))
    chosen = (r, gr, b)
    filters = build.choices.current_filter is not CurrentFilter.NONE
    if filters and build.choices.filter_use is FilterUse.FEW:
        filter_share = gathered_filter_share(one / (g.count + one), g, layers, build, settings)
        share = filtered_share(filter_share, p.filtered, build, settings)
        chosen = drawn_towards(chosen, p.filtered, share)
    stored = storable_colour(from_range(chosen, build), current, build)
    if build.choices.alpha_from is AlphaFrom.BLEND:
        alpha = alpha + alpha_share * (g.alpha / (g.count + one))
    return Resolved(stored, alpha, g.count + one)


def begin_layer(s: Surface, layers: Layers, w: Array, build: Build, frame: Record, *, far: bool) -> Gathered:
    """The sums of a layer before its way back: of the nearer one with the current sample whatever it shows, of the
    farther one if it shows that."""
    front = ~layers.edge | (s.centre > layers.cut)
    return first_sample(w, ~front if far else front | ~front, ~front if far else front, build, frame)


@dataclass(slots=True)
class Gathering:
    """Pixels on their way back through the frames in the ring: the nearer layer of each and, at depth edges, the
    farther."""

    pixel: Pixel
    motion: Motion
    layers: Layers
    slots: Array
    sides: list[tuple[Surface, Layers, Gathered, Track]]
    far: Gathered  # the sums of the farther side, or none

    @classmethod
    def begin(cls, build: Build, layout: Layout, given: Mapping[str, Any]) -> Gathering:
        """Before the first frame of the ring, as ``given`` to the kernel."""
        current, inverse_depth, motion, frame, settings = (
            given[name] for name in ("current", "inverse_depth", "motion", "frame", "settings")
        )
        rows = read_rows(current, inverse_depth, motion, build, layout, frame)
        p = current_pixel(rows, given["alpha"], given["reactive"], build, layout, frame)
        s = nearest_surface(*rows, build, settings["edge_tolerance"])
        m = surface_motion(s, build, layout, frame)
        slots = given["ring"].reshape(-1, ring_planes(build.steps), layout.rows, layout.stride)
        layers, past = layers_of(*rows, s, settings), given["past"][: given["frames"]]
        layered = build.choices.gather_fit is GatherFit.LAYERS
        if layered:
            s, layers = find_subpixel_feature(s, layers, slots, past, build, layout, settings)
        w = sample_share(p.own, build, settings)
        near, far = (begin_layer(s, layers, w, build, frame, far=side) for side in (False, True))
        if not layered:
            return cls(p, m, layers, slots, [(s, layers, near, Track.of(s, build))], far)
        fronts, backs = (
            side_of(s, layers, p.own, current, inverse_depth, motion, build, layout, frame, settings, far=side)
            for side in (False, True)
        )
        add_side(far, backs, p.own, build, settings)
        sides = [
            (side.surface, side.layers, g, Track.of(side.surface, build)) for side, g in ((fronts, near), (backs, far))
        ]
        return cls(p, m, layers, slots, sides, far)

    def add(
        self,
        past: Any,
        build: Build,
        layout: Layout,
        frame: Record,
        settings: Record,
        *,
        before: int = 0,
        recent: int = 0,
    ) -> None:
        """The samples of some frames in the ring, those that follow on what was gathered."""
        for place, (s, layers, sums, track) in enumerate(self.sides):
            gather_samples(
                self.slots,
                past,
                sums,
                self.pixel,
                s,
                layers,
                build,
                layout,
                frame,
                settings,
                far_only=place > 0,
                track=track,
                before=before,
                recent=0 if place else recent,
            )

    def resolved(self, build: Build, layout: Layout, settings: Record) -> Resolved:
        """The pixel from the samples gathered so far."""
        return resolve_gathered(self.near, self.far, self.layers, self.pixel, self.motion, build, layout, settings)

    @property
    def near(self) -> Gathered:
        """The sums of the nearer side, or of the only one."""
        return self.sides[0][2]


@quiet
def gather(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    inverse_depth: Array,
    motion: Array | None,
    alpha: Array | None,
    reactive: Array | None,
    ring: Array,
    past: Any,
    frames: int,
    output: Array,
    output_count: Array,
    frame: Record,
    settings: Record,
) -> None:
    """Resolve one frame from padded planes and ``frames`` kept ones into ``output`` and ``output_count``."""
    gathering = Gathering.begin(build, layout, locals())
    gathering.add(past[:frames], build, layout, frame, settings)
    store_resolved(gathering.resolved(build, layout, settings), build, layout, frame, output, output_count)
    extend_stored(build, layout, output[: 3 + build.steps.alpha], output_count)
