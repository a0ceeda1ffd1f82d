"""Twin of ``gather_sample.h``: the samples that a kept frame holds in and around a pixel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.parameters import GatherFit, LightChange
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import Pixel, as_reactive, sample_share, share_difference, usable_share
from cltaa.reference.colour import Colour, colour_outside_domain, to_range
from cltaa.reference.gather_fit import Gathered, Places, window
from cltaa.reference.gather_sides import Layers
from cltaa.reference.gather_track import KEPT_CLOSENESS, kept_alpha, kept_reactive, seen_then, texel_at
from cltaa.reference.neighbourhood import Surface, usable_closeness
from cltaa.reference.real import Array, Mask, number
from cltaa.reference.reprojection import Motion
from cltaa.reference.sampling import Footprint


class View(NamedTuple):
    """A kept frame as pixels see it: its planes and facts, the way there, the texels whose samples lie nearest to the
    centres, and where its samples lie and where they no longer count."""

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
    """One sample of a kept frame, ``right`` and ``down`` texels beside the nearest one."""
    current, fit = now.own, build.choices.gather_fit
    zero = np.zeros_like(current[0])
    share, dx, dy = v.weight_beside(right, down, fit, layout)
    good = share > zero
    if not good.any():
        return
    f = v.f._replace(row=v.f.row + down, column=v.f.column + right)
    c, q = _sample(v.planes, f, zero, v.then)
    good = good & ~colour_outside_domain(c)
    good = good & seen_then(q, s, v.m, build, settings)
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
    if build.steps.reactive and build.choices.light_change is LightChange.SPANS:
        r = usable_share(texel_at(v.planes[kept_reactive(build.steps)], f, zero.dtype), 0.0)
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
        a = usable_share(texel_at(v.planes[kept_alpha(build.steps)], f, zero.dtype), 1.0)
        g.alpha = g.alpha + counted * (a - now.alpha)


def _sample(planes: Array, f: Footprint, like: Array, then: Record) -> tuple[Colour, Array]:
    r, g, b = (texel_at(planes[channel], f, like.dtype) for channel in range(3))
    return (r, g, b), usable_closeness(texel_at(planes[KEPT_CLOSENESS], f, like.dtype), then)
