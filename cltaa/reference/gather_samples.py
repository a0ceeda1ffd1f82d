"""Twin of ``gather_sample.h`` and ``gather_fit.h``: the samples that lie in a pixel, and its colour from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.parameters import GatherFit, Illumination
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import Pixel, as_reactive, sample_share, share_difference, share_in_domain
from cltaa.reference.colour import Colour, colour_outside_domain, to_range
from cltaa.reference.gather_surfaces import (
    RING_INVERSE_DEPTH,
    Layers,
    matches_surface,
    ring_alpha,
    ring_reactive,
    texel_at,
)
from cltaa.reference.neighbourhood import Surface, inverse_depth_or_sky
from cltaa.reference.real import (
    Array,
    Mask,
    constant,
    lesser,
    limit,
    number,
)
from cltaa.reference.reprojection import Motion, pixel_grid
from cltaa.reference.sampling import Footprint


@dataclass(slots=True)
class Gathered:
    """Sums over the samples of a pixel: of differences from the current one, of weights, and of both times offsets."""

    zero: Array
    sum: list[Array] = field(init=False)
    along: list[Array] = field(init=False)
    down: list[Array] = field(init=False)
    alpha: Array = field(init=False)
    weight: Array = field(init=False)
    count: Array = field(init=False)
    x: Array = field(init=False)
    y: Array = field(init=False)
    xx: Array = field(init=False)
    xy: Array = field(init=False)
    yy: Array = field(init=False)
    near: Array = field(init=False)
    near_x: Array = field(init=False)
    near_y: Array = field(init=False)
    recent: list[Array] = field(init=False)
    recent_squares: Array = field(init=False)
    recent_count: Array = field(init=False)
    unlike: Array = field(init=False)  # of the recent samples, what was drawn with another reactivity

    def __post_init__(self) -> None:
        """No samples."""
        self.sum, self.along, self.down, self.recent = ([self.zero] * 3 for _ in range(4))
        names = "alpha weight count x y xx xy yy near near_x near_y"
        for name in f"{names} recent_squares recent_count unlike".split():
            setattr(self, name, self.zero)

    def add(self, d: list[Array], w: Array, dx: Array, dy: Array, near: Mask, fit: GatherFit) -> None:
        """One sample that differs by ``d`` and lies at (dx, dy) from the centre; of a farther one only the place."""
        n = np.where(near, w, self.zero) if fit is GatherFit.LAYERS else w
        self.sum = [total + n * k for total, k in zip(self.sum, d, strict=True)]
        self.weight = self.weight + w
        if fit is GatherFit.MEAN:
            return
        wx, wy, nx, ny = w * dx, w * dy, n * dx, n * dy
        self.x, self.y = self.x + wx, self.y + wy
        self.xx, self.xy, self.yy = self.xx + wx * dx, self.xy + wx * dy, self.yy + wy * dy
        self.along = [total + nx * k for total, k in zip(self.along, d, strict=True)]
        self.down = [total + ny * k for total, k in zip(self.down, d, strict=True)]
        self.near, self.near_x, self.near_y = self.near + n, self.near_x + nx, self.near_y + ny

    def add_recent(self, d: list[Array], counted: Array) -> None:
        """A recent sample that differs by ``d`` from the current one, of which ``counted`` counts."""
        self.recent = [total + counted * k for total, k in zip(self.recent, d, strict=True)]
        self.recent_squares = self.recent_squares + counted * ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2])
        self.recent_count = self.recent_count + counted


def first_sample(w: Array, counted: Mask, near: Mask, build: Build, frame: Record) -> Gathered:
    """The sums with the current sample alone, where it is ``counted``; none for a mean of the others."""
    zero = np.zeros_like(w)
    g = Gathered(zero)
    if build.choices.gather_fit is not GatherFit.MEAN:
        x, y = (np.full_like(w, number(frame[name], w)) for name in ("jitter_x", "jitter_y"))
        g.add([zero, zero, zero], np.where(counted, w, zero), x, y, near, build.choices.gather_fit)
    return g


class Fit(NamedTuple):
    """What the value at the pixel's centre takes of the sums: one * sum - (x * along + y * down)."""

    one: Array
    x: Array
    y: Array

    def value(self, total: Array, along: Array, down: Array) -> Array:
        """The value at the centre."""
        result: Array = self.one * total - (self.x * along + self.y * down)
        return result


def fit_at_centre(g: Gathered, samples: Array, settings: Record) -> Fit:
    """Weighted least squares of a plane, its slope held back by a ridge."""
    mean = number(1.0, samples) / g.weight
    mx, my = g.x * mean, g.y * mean
    ridge = number(settings["fit_ridge"], samples) * (g.weight / samples)
    xx, xy, yy = (g.xx - g.x * mx) + ridge, g.xy - g.x * my, (g.yy - g.y * my) + ridge
    det = xx * yy - xy * xy
    x, y = (yy * mx - xy * my) / det, (xx * my - xy * mx) / det
    return Fit(mean + (x * mx + y * my), x, y)


class Stretch(NamedTuple):
    """How one pixel step here is seen in an earlier frame, less the step itself."""

    xx: Array
    xy: Array
    yx: Array
    yy: Array


def stretch_of(
    s: Surface, slope: tuple[Array, Array], m: Motion, build: Build, layout: Layout, then: Record
) -> Stretch:
    """The derivative of the camera's motion on a plane whose inverse depth changes by ``slope`` a pixel."""
    zero, one = np.zeros_like(s.centre), np.ones_like(s.centre)
    if not build.steps.camera_motion:
        return Stretch(zero, zero, zero, zero)
    x, y = pixel_grid(layout, zero)
    f = {name: number(then[name], zero) for name in then.dtype.fields or ()}
    px, py, q = (x + s.x) + f["origin_x"], (y + s.y) + f["origin_y"], s.inverse_depth
    dw = ((f["wx"] * px + f["wy"] * py) + f["wq"] * q) + f["w1"]
    w = np.where(m.visible, one + dw, one)
    wx, wy = f["wx"] + f["wq"] * slope[0], f["wy"] + f["wq"] * slope[1]
    return Stretch(
        ((f["xx"] + f["xq"] * slope[0]) - dw - (px + m.u) * wx) / w,
        ((f["xy"] + f["xq"] * slope[1]) - (px + m.u) * wy) / w,
        ((f["yx"] + f["yq"] * slope[0]) - (py + m.v) * wx) / w,
        ((f["yy"] + f["yq"] * slope[1]) - dw - (py + m.v) * wy) / w,
    )


class Places(NamedTuple):
    """Where the samples of an earlier frame lie, seen from now: the nearest one, and the steps from it to the next to
    the right (xx, yx) and below (xy, yy)."""

    x: Array
    y: Array
    xx: Array
    xy: Array
    yx: Array
    yy: Array
    visible: Mask

    def beside(self, right: int, down: int) -> tuple[Array, Array]:
        """Offset of the sample ``right`` and ``down`` texels beside the nearest one from the pixel's centre."""
        r, d = number(right, self.x), number(down, self.x)
        return self.x + (self.xx * r + self.xy * d), self.y + (self.yx * r + self.yy * d)


def places_now(dx: Array, dy: Array, t: Stretch) -> Places:
    """The places of samples of which the nearest lies at (dx, dy) in its own frame."""
    one = number(1.0, dx)
    xx, yy = one + t.xx, one + t.yy
    det = xx * yy - t.xy * t.yx
    visible = det > constant("LEAST_W", dx)
    share = one / np.where(visible, det, one)
    xx, xy, yx, yy = yy * share, -t.xy * share, -t.yx * share, xx * share
    return Places(xx * dx + xy * dy, yx * dx + yy * dy, xx, xy, yx, yy, visible)


def reach_of(n: int, settings: Record, like: Array) -> Array:
    """Where the samples of ``n`` frames no longer count, from the pixel's centre along an axis."""
    half, most = number(0.5, like), number(settings["fit_reach"], like)
    reach: Array = lesser(most, half + number(1.0, like) / np.sqrt(number(n, like)))
    return reach


def window(off: Array, reach: Array) -> Array:
    """What counts of a sample ``off`` the centre along an axis; those a pixel apart count for one together."""
    zero, one = number(0.0, off), number(1.0, off)
    return limit((reach - np.abs(off)) * (one / ((reach + reach) - one)), zero, one)


class View(NamedTuple):
    """A frame of the ring as pixels see it: its planes and facts, the way there, the texels whose samples lie nearest
    to the centres, and where its samples lie and where they no longer count."""

    planes: Array
    then: Record
    m: Motion
    seen: Mask
    f: Footprint
    column: Array
    row: Array
    places: Places
    reach: Array
    recent: bool = False  # its samples are summed on their own too

    def weight_beside(self, right: int, down: int, fit: GatherFit, layout: Layout) -> tuple[Array, Array, Array]:
        """How much counts of the sample beside the nearest one, and its offset from the centre."""
        dx, dy = self.places.beside(right, down)
        half, zero = number(0.5, dx), np.zeros_like(dx)
        if fit is GatherFit.MEAN:
            return np.where(self.seen, np.ones_like(dx), zero), dx, dy
        column, row = self.column + number(right, dx), self.row + number(down, dx)
        inside = (column > -half) & (row > -half)
        inside &= (column < number(layout.width, dx) - half) & (row < number(layout.height, dx) - half)
        share = window(dx, self.reach) * window(dy, self.reach)
        return np.where(self.seen & self.places.visible & inside, share, zero), dx, dy


def gather_sample(
    g: Gathered,
    v: View,
    right: int,
    down: int,
    now: Pixel,
    s: Surface,
    layers: Layers,
    build: Build,
    layout: Layout,
    settings: Record,
    *,
    far_only: bool,
) -> None:
    """One sample of a frame of the ring, ``right`` and ``down`` texels beside the nearest one."""
    current, fit = now.own, build.choices.gather_fit
    zero = np.zeros_like(current[0])
    share, dx, dy = v.weight_beside(right, down, fit, layout)
    good = share > zero
    if not good.any():
        return
    f = v.f._replace(row=v.f.row + down, column=v.f.column + right)
    c, q = _sample(v.planes, f, zero, v.then)
    good = good & ~colour_outside_domain(c)
    good = good & matches_surface(q, s, v.m, build, settings)
    near = np.ones(zero.shape, bool)
    if fit is not GatherFit.MEAN:
        near = ~layers.edge | (q > layers.cut * v.m.scale + v.m.shift)
        good = good & ~near if far_only else good
    if build.steps.exposure:
        ratio = number(v.then["exposure_ratio"], zero)
        c = (c[0] * ratio, c[1] * ratio, c[2] * ratio)
    c = to_range(c, build)
    c = (np.where(good, c[0], current[0]), np.where(good, c[1], current[1]), np.where(good, c[2], current[2]))
    d = [a - b for a, b in zip(c, current, strict=True)]
    counted = np.where(good, share, zero)
    if build.steps.reactive and build.choices.illumination is Illumination.WINDOW:
        r = share_in_domain(texel_at(v.planes[ring_reactive(build.steps)], f, zero.dtype), 0.0)
        alike = as_reactive(r, now)
        if v.recent:
            g.unlike = g.unlike + counted * (np.ones_like(alike) - alike)
        counted = counted * alike
    w = counted * sample_share(c, build, settings)
    g.add(d, w, np.where(good, dx, zero), np.where(good, dy, zero), ~near if far_only else near, fit)
    g.count = g.count + counted
    if v.recent:
        g.add_recent(share_difference(c, current, build, settings), counted)
    if build.steps.alpha:
        a = share_in_domain(texel_at(v.planes[ring_alpha(build.steps)], f, zero.dtype), 1.0)
        g.alpha = g.alpha + counted * (a - now.alpha)


def _sample(planes: Array, f: Footprint, like: Array, then: Record) -> tuple[Colour, Array]:
    r, g, b = (texel_at(planes[channel], f, like.dtype) for channel in range(3))
    return (r, g, b), inverse_depth_or_sky(texel_at(planes[RING_INVERSE_DEPTH], f, like.dtype), then)
