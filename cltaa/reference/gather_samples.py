"""Twin of ``gather/samples.h``: the samples that other frames rendered inside a pixel."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Record
from cltaa.core.constants import value
from cltaa.core.parameters import Illumination, Reject
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import Pixel, luminance_weight, reactivity_weight, weighted_difference
from cltaa.reference.colour import Colour, outside_domain_of, share_in_domain, to_range
from cltaa.reference.disocclusion import on_screen
from cltaa.reference.gather_fit import SampleSums, first_sample, own_samples
from cltaa.reference.gather_sides import Layers, Side, range_of_side
from cltaa.reference.gather_track import (
    MOTION,
    RING_INVERSE_DEPTH,
    Track,
    matches_surface,
    no_motion_vector,
    ring_alpha,
    ring_reactive,
    texel_at,
)
from cltaa.reference.neighbourhood import Surface, inverse_depth_or_sky
from cltaa.reference.real import NEIGHBOURS, Array, Mask, Run, greater, lesser, limit, number
from cltaa.reference.reprojection import Motion, motion_from_depth, pixel_grid
from cltaa.reference.sampling import Footprint, footprint_of


class Jacobian(NamedTuple):
    """Jacobian of the motion to another frame, and the parallax of a unit of inverse depth."""

    xx: Array
    xy: Array
    yx: Array
    yy: Array
    parallax: Array


def jacobian_of(s: Surface, slope: tuple[Array, Array], m: Motion, run: Run, then: Record) -> Jacobian:
    """The derivative of the camera's motion on a plane whose inverse depth changes by ``slope`` a pixel."""
    zero = np.zeros_like(s.centre)
    if not run.steps.camera_motion:
        return Jacobian(zero, zero, zero, zero, zero)
    x, y = pixel_grid(run.layout, zero)
    f = {name: number(then[name], zero) for name in then.dtype.fields or ()}
    px, py, q = (x + s.x) + f["origin_x"], (y + s.y) + f["origin_y"], s.inverse_depth
    dw = ((f["wx"] * px + f["wy"] * py) + f["wq"] * q) + f["w1"]
    w = np.where(m.visible, 1.0 + dw, 1.0)
    wx, wy = f["wx"] + f["wq"] * slope[0], f["wy"] + f["wq"] * slope[1]
    across, down = f["xq"] - (px + m.u) * f["wq"], f["yq"] - (py + m.v) * f["wq"]
    return Jacobian(
        ((f["xx"] + f["xq"] * slope[0]) - dw - (px + m.u) * wx) / w,
        ((f["xy"] + f["xq"] * slope[1]) - (px + m.u) * wy) / w,
        ((f["yx"] + f["yq"] * slope[0]) - (py + m.v) * wx) / w,
        ((f["yy"] + f["yq"] * slope[1]) - dw - (py + m.v) * wy) / w,
        greater(np.abs(across), np.abs(down)) / w,
    )


class SampleGrid(NamedTuple):
    """Positions of another frame's samples, seen from the current one: the nearest one, and the steps from it to the
    next to the right (xx, yx) and below (xy, yy)."""

    x: Array
    y: Array
    xx: Array
    xy: Array
    yx: Array
    yy: Array
    visible: Mask

    def offset(self, right: int, down: int) -> tuple[Array, Array]:
        """Offset from the pixel's centre of the sample ``right`` and ``down`` texels beside the nearest one."""
        return self.x + (self.xx * right + self.xy * down), self.y + (self.yx * right + self.yy * down)


def sample_grid(dx: Array, dy: Array, t: Jacobian) -> SampleGrid:
    """Positions of samples of which the nearest lies at (dx, dy) in its own frame."""
    xx, yy = 1.0 + t.xx, 1.0 + t.yy
    det = xx * yy - t.xy * t.yx
    visible = det > value("LEAST_W")
    share = 1.0 / np.where(visible, det, 1.0)
    xx, xy, yx, yy = yy * share, -t.xy * share, -t.yx * share, xx * share
    return SampleGrid(xx * dx + xy * dy, yx * dx + yy * dy, xx, xy, yx, yy, visible)


def reach_of(n: int, settings: Record, like: Array) -> Array:
    """Distance from the pixel's centre along an axis from which samples of ``n`` frames have no weight."""
    half, most = number(0.5, like), number(settings["fit_reach"], like)
    return lesser(most, half + number(1.0, like) / np.sqrt(number(n, like)))


def trapezoid(off: Array, reach: Array) -> Array:
    """Weight of a sample ``off`` the centre along an axis; samples a pixel apart have weight 1 together."""
    return limit((reach - np.abs(off)) * (1.0 / ((reach + reach) - 1.0)), 0.0, 1.0)


class View(NamedTuple):
    """A frame of the ring seen from pixels: its planes and record, the motion to it, the texels whose samples lie
    nearest to the centres, the positions of its samples, the surface's inverse depth at the centre now, the parallax of
    a unit of it, and the distance from which samples have no weight."""

    planes: Array
    then: Record
    m: Motion
    seen: Mask
    f: Footprint
    column: Array
    row: Array
    grid: SampleGrid
    inverse_depth: Array
    parallax: Array
    reach: Array
    recent: bool = False  # its samples are also summed separately
    static_ahead: Mask | None = None  # the surfaces without own motion, in a later frame

    def neighbour_weight(self, right: int, down: int, layout: Layout) -> tuple[Array, Array, Array]:
        """Weight of the sample beside the nearest one, and its offset from the centre."""
        dx, dy = self.grid.offset(right, down)
        column, row = self.column + right, self.row + down
        inside = (column > -0.5) & (row > -0.5)
        inside &= (column < layout.width - 0.5) & (row < layout.height - 0.5)
        share = trapezoid(dx, self.reach) * trapezoid(dy, self.reach)
        return np.where(self.seen & self.grid.visible & inside, share, 0.0), dx, dy


def keeps_to_surface(q: Array, dx: Array, dy: Array, v: View, layers: Layers) -> Mask:
    """True where the parallax of a sample's own depth puts it near to where the plane of the surface does."""
    plane = (v.inverse_depth + (layers.slope[0] * dx + layers.slope[1] * dy)) * v.m.scale + v.m.shift
    return np.abs(q - plane) * v.parallax <= value("LARGEST_PARALLAX") * v.m.scale


def holds_rim(v: View, f: Footprint, q: Array, alpha: Array, now: Pixel) -> Mask:
    """True where a sample of the sky is more opaque than the pixel, and beside a sample that has depth."""
    sky = number(v.then["sky_inverse_depth"], q)
    beside = np.zeros(q.shape, bool)
    for right, down in NEIGHBOURS:
        there = f._replace(row=f.row + down, column=f.column + right)
        beside |= inverse_depth_or_sky(texel_at(v.planes[RING_INVERSE_DEPTH], there, q.dtype), v.then) > sky
    return (q <= sky) & (alpha > now.alpha) & beside


def gather_sample(
    g: SampleSums, v: View, right: int, down: int, now: Pixel, s: Surface, layers: Layers, run: Run, *, far_only: bool
) -> None:
    """Add one sample of a frame of the ring, ``right`` and ``down`` texels beside the nearest one."""
    current = now.own
    zero = np.zeros_like(current[0])
    share, dx, dy = v.neighbour_weight(right, down, run.layout)
    good = share > zero
    if not good.any():
        return
    f = v.f._replace(row=v.f.row + down, column=v.f.column + right)
    c = texel_at(v.planes[:3], f, zero.dtype)
    q = inverse_depth_or_sky(texel_at(v.planes[RING_INVERSE_DEPTH], f, zero.dtype), v.then)
    opacity = texel_at(v.planes[ring_alpha(run.steps)], f, zero.dtype) if run.steps.alpha else None
    good = good & ~outside_domain_of(c, opacity)
    good = good & matches_surface(q, s, v.m, run)
    alpha = zero
    if opacity is not None:
        alpha = share_in_domain(opacity, 1.0)
        good = good & ~holds_rim(v, f, q, alpha, now)
        alpha = alpha - now.alpha
    if v.static_ahead is not None:
        moves = ~no_motion_vector(*texel_at(v.planes[MOTION], f, zero.dtype))
        good = good & ~(v.static_ahead & moves)
    near = ~layers.edge | (q > layers.cut * v.m.scale + v.m.shift)
    good = good & ~near if far_only else good
    if run.steps.camera_motion and run.choices.reject is not Reject.NONE:
        good = good & (keeps_to_surface(q, dx, dy, v, layers) | (near if far_only else ~near))
    if run.steps.exposure:
        c = c * v.then["exposure_ratio"]
    c = np.where(good, to_range(c, run.build), current)
    counted = np.where(good, share, zero)
    if run.steps.reactive and run.choices.illumination is Illumination.WINDOW:
        r = share_in_domain(texel_at(v.planes[ring_reactive(run.steps)], f, zero.dtype), 0.0)
        weight = reactivity_weight(r, now)
        if v.recent:
            g.unlike = g.unlike + counted * (1.0 - weight)
        counted = counted * weight
    w = counted * luminance_weight(c, run)
    g.add(c - current, w, np.where(good, dx, zero), np.where(good, dy, zero), ~near if far_only else near)
    g.count = g.count + counted
    g.alpha = g.alpha + w * alpha
    if v.recent:
        g.add_recent(weighted_difference(c, current, run), alpha, counted, run.build)


def motion_to_frame(track: Track, s: Surface, layers: Layers, run: Run, then: Record) -> tuple[Motion, Jacobian]:
    """The motion of the pixel's centre to a frame of the ring, and its Jacobian."""
    zero = np.zeros_like(s.centre)
    m = motion_from_depth(s, run.build, run.layout, then)
    jacobian = jacobian_of(s, layers.slope, m, run, then)
    ox, oy = s.x + run.frame["jitter_x"], s.y + run.frame["jitter_y"]
    m = m._replace(u=m.u - (jacobian.xx * ox + jacobian.xy * oy), v=m.v - (jacobian.yx * ox + jacobian.yy * oy))
    if run.steps.own_motion:
        m = track.motion(m)
        jacobian = Jacobian(*(np.where(track.own, zero, part) for part in jacobian))
    return m, jacobian


def _view(
    planes: Array,
    m: Motion,
    seen: Mask,
    jacobian: Jacobian,
    inverse_depth: Array,
    reach: Array,
    layout: Layout,
    then: Record,
) -> tuple[Motion, View]:
    """The motion to the texels whose samples lie nearest, and the frame seen from there."""
    half = number(0.5, m.u)
    u, v = m.u + (half - number(then["jitter_x"], m.u)), m.v + (half - number(then["jitter_y"], m.u))
    nearest = m._replace(u=u, v=v)
    f = footprint_of(nearest, seen, layout)
    x, y = pixel_grid(layout, m.u)
    grid = sample_grid(half - f.fx, half - f.fy, jacobian)
    column, row = (x + u) - f.fx, (y + v) - f.fy
    return nearest, View(planes, then, m, seen, f, column, row, grid, inverse_depth, jacobian.parallax, reach)


def begin_layer(s: Surface, layers: Layers, p: Pixel, run: Run, *, far: bool) -> SampleSums:
    """Sums of a layer before it is followed: the nearer one holds the current sample whatever that shows, the farther
    one only if it shows the farther side; neither holds a missing one."""
    front, drawn, w = (
        ~layers.edge | (s.centre > layers.cut),
        own_samples(p) > 0,
        luminance_weight(p.own, run),
    )
    return first_sample(w, ~front & drawn if far else drawn, ~front if far else front, run)


def add_side(g: SampleSums, side: Side, current: Colour, run: Run) -> None:
    """Add the mean of a side's texels in the current 3x3 as one sample."""
    zero = np.zeros_like(side.count)
    some = side.count > zero
    w = np.where(some, luminance_weight(side.mean, run), zero)
    g.add(side.mean - current, w, zero, zero, some)


def gather_samples(
    ring: Array,
    past: Any,
    g: SampleSums,
    now: Pixel,
    s: Surface,
    layers: Layers,
    run: Run,
    *,
    far_only: bool,
    track: Track,
    before: int,
    recent: int,
) -> SampleSums:
    """Add the samples of ``now`` on ``s`` in the ring frames [slots, planes, rows, stride] of ``past``, latest first,
    the next ones in turn with them, to ``g``.

    ``track`` holds the own motion over the ``before`` frames before them, and is continued; samples of the first
    ``recent`` frames are also summed separately.
    """
    zero = np.zeros_like(now.own[0])
    own_motion = run.steps.own_motion
    followed = range_of_side(s, layers, far=far_only)
    reach = reach_of(before + len(past) + 1, run.settings, zero)
    ox, oy = s.x + run.frame["jitter_x"], s.y + run.frame["jitter_y"]
    inverse_depth = s.inverse_depth - (ox * layers.slope[0] + oy * layers.slope[1])
    for k, then in enumerate(past):
        planes = ring[int(then["slot"])]
        ahead = run.steps.look_ahead and then["ahead"] > 0
        t = track.ahead_of(s, run.build) if ahead else track
        if own_motion and ahead:
            t.step_ahead(followed, planes, run, then)
        m, jacobian = motion_to_frame(t, s, layers, run, then)
        seen = on_screen(m, run.layout) & ~t.lost
        nearest, v = _view(planes, m, seen, jacobian, inverse_depth, reach, run.layout, then)
        v = v._replace(recent=k < recent, static_ahead=~t.own if own_motion and ahead else None)
        for right, down in NEIGHBOURS:
            gather_sample(g, v, right, down, now, s, layers, run, far_only=far_only)
        if own_motion and not ahead:
            there = footprint_of(nearest._replace(u=nearest.u + s.x, v=nearest.v + s.y), v.seen, run.layout)
            track.step_back(followed, m, v.planes, there, v.seen, run, then)
    return g
