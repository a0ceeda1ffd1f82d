"""Twin of ``stages.cl``: thin wrappers that read planes, call a stage and write planes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.parameters import FilterUse
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import Pixel, load_shares, rectified_alpha, resolve_pixel, without_missing
from cltaa.reference.colour import Colour, colour_in_domain, from_units, in_units, repaired_planes, whole_samples
from cltaa.reference.dilation import borrowed_surface
from cltaa.reference.fireflies import without_firefly
from cltaa.reference.history import History, sample_history
from cltaa.reference.neighbourhood import Statistics, Surface, current_sample, nearest_surface, neighbourhood_statistics
from cltaa.reference.planes import read_rows, store_recurrent
from cltaa.reference.real import Array, Run, quiet, real_type
from cltaa.reference.rectify import Rectification, box_scale_of, rectify
from cltaa.reference.reprojection import Motion, surface_motion


def repair_colour_kernel(
    build: Build, layout: Layout, *, current: Array, alpha: Array | None, repaired: Array, frame: Record
) -> None:
    """``repaired`` [3, rows, stride]: ``current`` with every texel outside the domain replaced."""
    current, _ = whole_samples(current, alpha, Run(build, layout, frame))
    layout.inside(repaired)[:] = layout.inside(repaired_planes(current, layout))


@quiet
def neighbourhood_statistics_kernel(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    alpha: Array | None,
    inverse_depth: Array,
    motion: Array | None,
    statistics_out: Array,
    frame: Record,
) -> None:
    """``statistics_out`` [15, rows, stride]: mean, deviation, low and high in the box space, and the current sample."""
    run = Run(build, layout, frame)
    current, _ = whole_samples(current, alpha, run)
    rows = read_rows(current, inverse_depth, motion, run)
    near = neighbourhood_statistics(*rows, run)
    sample = current_sample(*rows, near, run)
    in_box = (in_units(colour, build) for colour in near)
    _store(statistics_out, layout, (part for colour in (*in_box, sample) for part in colour))


@quiet
def surface_motion_kernel(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    alpha: Array | None,  # noqa: ARG001
    inverse_depth: Array,
    motion: Array | None,
    motion_out: Array,
    frame: Record,
    settings: Record,
) -> None:
    """``motion_out`` [10, rows, stride]: u, v, scale, shift, visible, nearest, farthest and the pixel's own inverse
    depth, and the surface's offset from the pixel."""
    run = Run(build, layout, frame, settings)
    rows = read_rows(current, inverse_depth, motion, run)
    s = nearest_surface(*rows, run)
    s = borrowed_surface(s, inverse_depth, motion, run)
    m = surface_motion(s, run)
    visible = np.where(m.visible, np.ones_like(m.u), 0.0)
    _store(motion_out, layout, (m.u, m.v, m.scale, m.shift, visible, s.nearest, s.farthest, s.centre, s.x, s.y))


@quiet
def sample_history_kernel(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    alpha: Array | None,
    motion_in: Array,
    history: Array,
    history_count: Array,
    previous_inverse_depth: Array,
    history_at: Array,
    frame: Record,
    settings: Record,
) -> None:
    """``history_at`` [9, rows, stride]: r, g, b, alpha, count, fx, fy, valid, illumination change."""
    run = Run(build, layout, frame, settings)
    current, alpha = whole_samples(current, alpha, run)
    u, v, scale, shift, visible, nearest, farthest, centre, at_x, at_y = _load(motion_in, run)
    m = Motion(u, v, scale, shift, visible > 0.5)
    s = Surface(at_x, at_y, u, u, u, centre, nearest, farthest)  # sample_history reads nothing else
    h = sample_history(current, alpha, history, history_count, previous_inverse_depth, m, s, run)
    valid = np.where(h.valid, np.ones_like(u), 0.0)
    _store(history_at, layout, (*h.rgb, h.alpha, h.count, h.fx, h.fy, valid, h.change))


@quiet
def rectify_history_kernel(
    build: Build,
    layout: Layout,
    *,
    statistics_in: Array,
    motion_in: Array,
    history_at: Array,
    change_out: Array,
    frame: Record,
    settings: Record,
) -> None:
    """``change_out`` [5, rows, stride]: change of r, g, b, blend boost, anti-flicker factor."""
    run = Run(build, layout, frame, settings)
    near, sample = _load_statistics(statistics_in, run)
    m = _load(motion_in, run)
    moved = Motion(m[0], m[1], m[2], m[3], m[4] > 0.5)
    past = _load(history_at[:3], run)
    change = rectify(past, sample, near, moved, box_scale_of(moved, run), run)
    _store(change_out, layout, (*change.change, change.blend_boost, change.anti_flicker_factor))


@quiet
def blend_kernel(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    alpha: Array | None,
    reactive: Array | None,
    statistics_in: Array,
    history_at: Array,
    change_in: Array,
    output: Array,
    output_count: Array,
    frame: Record,
    settings: Record,
) -> None:
    """``output`` [3 or 4, rows, stride] and ``output_count``: the result of the frame."""
    run = Run(build, layout, frame, settings)
    current, alpha = whole_samples(current, alpha, run)
    past = _load(history_at, run)
    opacity, count, fx, fy, valid, light = past[3:]
    h = History(past[:3], opacity, count, fx, fy, valid > 0.5, light)
    change = _load(change_in, run)
    near, sample = _load_statistics(statistics_in, run)
    few = build.choices.filter_use is FilterUse.FEW
    own = colour_in_domain(current, run) if few else sample
    shares = load_shares(alpha, reactive, count, run)
    p = Pixel(own, sample, *shares, near, shares[1], shares[1])
    p = without_firefly(p, current, h, run)
    r = Rectification(change[:3], *change[3:])._replace(alpha=rectified_alpha(alpha, opacity, run))
    out = without_missing(resolve_pixel(p, h, r, run), h, current, alpha, run)
    store_recurrent(out, run, output, output_count)


def _load(planes: Array, run: Run) -> Array:
    return run.layout.inside(planes).astype(real_type(run.build))


def _load_statistics(planes: Array, run: Run) -> tuple[Statistics, Colour]:
    """The statistics of the neighbourhood, and the current sample."""
    v = _load(planes, run)
    parts = (from_units(v[i : i + 3], run.build) for i in range(0, 12, 3))
    return Statistics(*parts), v[12:]


def _store(planes: Array, layout: Layout, values: Iterable[Array]) -> None:
    for plane, value in zip(planes, values, strict=True):
        layout.inside(plane)[:] = value
