"""Twin of ``gather_thin.h``: things thinner than a pixel, which the samples of one frame hit here and miss there."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.constants import THIN_COLUMNS, THIN_FARTHER, THIN_ROWS, THIN_STEP
from cltaa.core.parameters import ThinSearch
from cltaa.core.planes import Layout
from cltaa.reference.gather_sides import NEIGHBOURS, Layers, texels_beside
from cltaa.reference.gather_track import KEPT_CLOSENESS, KEPT_MOTION, texel_at, untold
from cltaa.reference.neighbourhood import Surface, usable_closeness
from cltaa.reference.real import Array, Mask, constant, greater, number
from cltaa.reference.reprojection import motion_from_depth, on_screen
from cltaa.reference.sampling import footprint_of


class Thin(NamedTuple):
    """What was found of things that the 3x3 of now misses: whether, how far off the centre, and how close it is."""

    found: Mask
    off: Array
    closeness: Array


def recall_thin(
    s: Surface,
    layers: Layers,
    kept: Array,
    past: Any,
    build: Build,
    layout: Layout,
    frame: Record,
    settings: Record,
    *,
    beside: Array | None,
) -> tuple[Surface, Layers]:
    """``s`` and ``layers`` with the surface that the latest kept frames show in front of all that the 3x3 shows now,
    where it now lies near the pixel's centre and the camera alone moves it; with the current closeness given as
    ``beside`` looked for along the way of the nearest thing around too."""
    zero, half = np.zeros_like(s.centre), number(0.5, s.centre)
    none = np.zeros(zero.shape, bool)
    open_here = ~layers.edge & (untold(s.u, s.v) if build.steps.own_motion else ~none)
    thin = Thin(none, np.full_like(zero, constant("THIN_REACH", zero)), s.closeness)
    count = int(settings["thin_frames"])
    thin = look_for_thin(thin, open_here, s, s, kept, past[:count], build, layout, settings, beside=False)
    if build.choices.thin_search is ThinSearch.BESIDE and beside is not None:
        along = nearest_around(s, beside, layout, frame)
        nearer = along.closeness - s.nearest
        other = open_here & (nearer > number(settings["edge_tolerance"], zero) * np.abs(along.closeness))
        told = past[: THIN_FARTHER * count]
        thin = look_for_thin(thin, other, along, s, kept, told, build, layout, settings, beside=True)
    slope_x, slope_y = (np.where(thin.found, zero, slope) for slope in layers.slope)
    cut = np.where(thin.found, half * (thin.closeness + s.nearest), layers.cut)
    nearest = np.where(thin.found, thin.closeness, s.nearest)
    edge = layers.edge | thin.found
    return s._replace(closeness=thin.closeness, nearest=nearest), Layers(edge, cut, (slope_x, slope_y))


def nearest_around(s: Surface, closeness: Array, layout: Layout, frame: Record) -> Surface:
    """``s``, as far away as the nearest thing that pixels around show."""
    nearest = s.nearest
    for dy in range(-THIN_ROWS, THIN_ROWS + 1, THIN_ROWS):
        for dx in range(-THIN_COLUMNS, THIN_COLUMNS + 1, THIN_STEP):
            beside = texels_beside(closeness[0], dx, dy, layout, nearest.dtype)
            nearest = greater(nearest, usable_closeness(beside, frame))
    return s._replace(closeness=nearest)


def look_for_thin(
    thin: Thin,
    open_here: Mask,
    along: Surface,
    s: Surface,
    kept: Array,
    past: Any,
    build: Build,
    layout: Layout,
    settings: Record,
    *,
    beside: bool,
) -> Thin:
    """What the kept frames ``past`` show near the pixel, at the place of surface ``along``, in front of all that the
    3x3 shows now of ``s``, if that is nearer than ``thin``; where that is ``beside`` only what lies within THIN_ROOM
    counts as filling it."""
    found, least, closeness = thin.found, thin.off, thin.closeness
    zero, half = np.zeros_like(s.centre), number(0.5, s.centre)
    real: Any = zero.dtype
    own_motion = build.steps.own_motion
    for then in past:
        planes = kept[int(then["slot"])]
        m = motion_from_depth(along, build, layout, then)
        seen = open_here & on_screen(m, layout)
        u = m.u + (half - number(then["jitter_x"], zero))
        v = m.v + (half - number(then["jitter_y"], zero))
        f = footprint_of(m._replace(u=u, v=v), seen, layout)
        near = s.nearest * m.scale + m.shift
        high = near + number(settings["depth_tolerance"], zero) * np.abs(near)
        hits, best, thinner = zero, least, closeness
        for dx, dy in NEIGHBOURS:
            there = f._replace(row=f.row + dy, column=f.column + dx)
            q = usable_closeness(texel_at(planes[KEPT_CLOSENESS], there, real), then)
            nearer = seen & (q > high)
            hit = s._replace(closeness=(q - m.shift) / m.scale)
            way = motion_from_depth(hit, build, layout, then)
            ox = ((half - f.fx) + number(dx, zero)) + (m.u - way.u)
            oy = ((half - f.fy) + number(dy, zero)) + (m.v - way.v)
            off = greater(np.abs(ox), np.abs(oy))
            counts = nearer & (off < constant("THIN_ROOM", zero)) if beside else nearer
            hits = hits + np.where(counts, number(1.0, zero), zero)
            if own_motion:
                nearer = nearer & untold(*(texel_at(planes[KEPT_MOTION + axis], there, real) for axis in (0, 1)))
            here = nearer & way.visible & (off < best)
            best, thinner = np.where(here, off, best), np.where(here, hit.closeness, thinner)
        is_thin = (best < least) & (hits <= constant("THIN_HITS", zero))
        least, closeness = np.where(is_thin, best, least), np.where(is_thin, thinner, closeness)
        found = found | is_thin
    return Thin(found, least, closeness)
