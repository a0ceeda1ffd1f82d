"""Twin of ``gather/fit.h``: from the samples in a pixel to its colour."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.parameters import AlphaFrom, CurrentFilter, FilterUse, Illumination
from cltaa.reference.accumulate import (
    Pixel,
    Resolved,
    disoccluded_colour,
    fading_share,
    filtered_share,
    lerp_colour,
    storable,
)
from cltaa.reference.colour import Colour, accumulates_alpha, from_range, inner
from cltaa.reference.gather_sides import Layers
from cltaa.reference.real import Array, Mask, Run, limit
from cltaa.reference.rectify import box_scale_of, rectify
from cltaa.reference.reprojection import Motion


class SampleSums:
    """Sums over the samples of a pixel: of differences from the current one, of weights, and of both times offsets."""

    def __init__(self, zero: Array) -> None:
        """Sums of no samples."""
        self.zero = zero
        self.sum = self.along = self.down = self.recent = np.stack([zero] * 3)
        self.alpha = self.weight = self.count = self.recent_alpha = self.recent_squares = self.recent_count = zero
        self.x = self.y = self.xx = self.xy = self.yy = self.near = self.near_x = self.near_y = zero
        self.unlike = zero  # weight that recent samples lose because they were rendered with another reactivity

    def add(self, d: Colour, w: Array, dx: Array, dy: Array, near: Mask) -> None:
        """Add a sample that differs by ``d`` and lies at (dx, dy) from the centre; a farther one adds its position
        only."""
        n = np.where(near, w, self.zero)
        self.sum = self.sum + n * d
        self.weight = self.weight + w
        wx, wy, nx, ny = w * dx, w * dy, n * dx, n * dy
        self.x, self.y = self.x + wx, self.y + wy
        self.xx, self.xy, self.yy = self.xx + wx * dx, self.xy + wx * dy, self.yy + wy * dy
        self.along, self.down = self.along + nx * d, self.down + ny * d
        self.near, self.near_x, self.near_y = self.near + n, self.near_x + nx, self.near_y + ny

    def add_recent(self, d: Colour, alpha: Array, counted: Array, build: Build) -> None:
        """Add a recent sample that differs by ``d`` and ``alpha`` from the current one, with weight ``counted``."""
        self.recent = self.recent + counted * d
        self.recent_squares = self.recent_squares + counted * inner(d, d)
        if accumulates_alpha(build):
            self.recent_alpha = self.recent_alpha + counted * alpha
            self.recent_squares = self.recent_squares + counted * (alpha * alpha)
        self.recent_count = self.recent_count + counted


def first_sample(w: Array, counted: Mask, near: Mask, run: Run) -> SampleSums:
    """Sums of the current sample alone, where it is ``counted``."""
    zero = np.zeros_like(w)
    g = SampleSums(zero)
    x, y = (np.full_like(w, run.frame[name]) for name in ("jitter_x", "jitter_y"))
    g.add(np.zeros_like(g.sum), np.where(counted, w, zero), x, y, near)
    return g


class Fit(NamedTuple):
    """Factors of the sums that give the value at the pixel's centre: one * sum - (x * along + y * down)."""

    one: Array
    x: Array
    y: Array

    def value(self, total: Array, along: Array, down: Array) -> Array:
        """The value at the centre, of numbers or of colours."""
        return self.one * total - (self.x * along + self.y * down)


def fit_at_centre(g: SampleSums, samples: Array, settings: Record) -> Fit:
    """Weighted least squares of a plane, its slope damped by a ridge."""
    mean = 1.0 / g.weight
    mx, my = g.x * mean, g.y * mean
    ridge = settings["fit_ridge"] * (g.weight / samples)
    xx, xy, yy = (g.xx - g.x * mx) + ridge, g.xy - g.x * my, (g.yy - g.y * my) + ridge
    det = xx * yy - xy * xy
    x, y = (yy * mx - xy * my) / det, (xx * my - xy * mx) / det
    return Fit(mean + (x * mx + y * my), x, y)


def gathered_change(g: SampleSums, far: SampleSums, layers: Layers, samples: Array, settings: Record) -> Colour:
    """Colour of the ``samples`` of a pixel [H, W] minus the current one."""
    f = fit_at_centre(g, samples, settings)
    v = f.value(g.sum, g.along, g.down)
    seen = 1.0 - limit(f.value(g.near, g.near_x, g.near_y), 0.0, 1.0)
    any_of = far.weight > 0.0
    instead = np.where(any_of, far.weight, np.where(g.near > 0.0, g.near, 1.0))
    mean = np.where(layers.edge, seen, 0.0) / instead
    return v + mean * np.where(any_of, far.sum, g.sum)


def own_samples(p: Pixel) -> Array:
    """Samples of each pixel in the current frame [H, W]: one, or none."""
    one = np.ones_like(p.alpha)
    return one if p.missing is None else np.where(p.missing, 0.0, one)


def reactive_loss(reactivity: Array, build: Build) -> Array:
    """Share of its samples that a reactive pixel [H, W] gives up for the current one."""
    square: Array = reactivity * reactivity
    return square * square if build.choices.illumination is Illumination.WINDOW else reactivity


def takes_alpha_of_others(p: Pixel, build: Build) -> Mask:
    """True where the alpha of other samples counts: where alpha is blended, and where a pixel has none of its own."""
    return np.asarray((own_samples(p) == 0.0) | (build.choices.alpha_from is AlphaFrom.BLEND))


def resolve_gathered(g: SampleSums, far: SampleSums, layers: Layers, p: Pixel, m: Motion, run: Run) -> Resolved:
    """Resolve the pixel from its samples and the current one if not missing; a pixel without any is filled."""
    current, alpha = p.own, p.alpha
    one, samples = np.ones_like(alpha), g.count + own_samples(p)
    any_of = g.count > 0.0
    weight = np.where(any_of, g.weight, one)
    past = current + gathered_change(g, far, layers, samples, run.settings)
    moved = rectify(past, current, p.stats, m, box_scale_of(m, run), run).change
    share = one - reactive_loss(p.reactivity, run.build) if run.steps.reactive else one
    mixed = current + share * ((past - current) + moved)
    chosen = np.where(any_of, mixed, disoccluded_colour(current, p.stats.mean, run))
    filters = run.choices.current_filter is not CurrentFilter.NONE
    if filters and run.choices.filter_use is FilterUse.FEW:
        of_filter = fading_share(one / (g.count + one), run.settings)
        chosen = lerp_colour(chosen, p.filtered, filtered_share(of_filter, p.filtered, run))
    missing = own_samples(p) == 0.0
    of_all = alpha + np.where(missing, one, share) * (g.alpha / weight)
    alpha = np.where(takes_alpha_of_others(p, run.build), of_all, alpha)
    if p.filled is not None:
        filled, opacity = p.filled
        chosen = np.where(missing, np.where(any_of, past, filled), chosen)
        alpha = np.where(missing & ~any_of, opacity, alpha)
    stored = storable(from_range(chosen, run.build), current, run.build)
    return Resolved(stored, limit(alpha, 0.0, 1.0), samples)
