"""Twin of ``gather_thin.h``: things thinner than a pixel, which the samples of one frame hit here and miss there."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.planes import Layout
from cltaa.reference.gather_sides import NEIGHBOURS, Layers
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
    settings: Record,
) -> tuple[Surface, Layers]:
    """``s`` and ``layers`` with the surface that the latest kept frames show in front of all that the 3x3 shows now,
    where it now lies near the pixel's centre and the camera alone moves it."""
    zero, half = np.zeros_like(s.centre), number(0.5, s.centre)
    open_here = ~layers.edge & untold(s.u, s.v) if build.steps.own_motion else ~layers.edge
    latest = past[: int(settings["thin_frames"])]
    thin = look_for_thin(open_here, s, kept, latest, build, layout, settings)
    slope_x, slope_y = (np.where(thin.found, zero, slope) for slope in layers.slope)
    cut = np.where(thin.found, half * (thin.closeness + s.nearest), layers.cut)
    nearest = np.where(thin.found, thin.closeness, s.nearest)
    edge = layers.edge | thin.found
    return s._replace(closeness=thin.closeness, nearest=nearest), Layers(edge, cut, (slope_x, slope_y))


def look_for_thin(
    open_here: Mask, s: Surface, kept: Array, past: Any, build: Build, layout: Layout, settings: Record
) -> Thin:
    """What the kept frames ``past`` show near the pixel in front of all that the 3x3 shows now of ``s``."""
    zero, half = np.zeros_like(s.centre), number(0.5, s.centre)
    found, least, closeness = np.zeros(zero.shape, bool), np.full_like(zero, constant("THIN_REACH", zero)), s.closeness
    real: Any = zero.dtype
    own_motion = build.steps.own_motion
    for then in past:
        planes = kept[int(then["slot"])]
        m = motion_from_depth(s, build, layout, then)
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
            hits = hits + np.where(nearer, number(1.0, zero), zero)
            if own_motion:
                nearer = nearer & untold(*(texel_at(planes[KEPT_MOTION + axis], there, real) for axis in (0, 1)))
            here = nearer & way.visible & (off < best)
            best, thinner = np.where(here, off, best), np.where(here, hit.closeness, thinner)
        is_thin = (best < least) & (hits <= constant("THIN_HITS", zero))
        least, closeness = np.where(is_thin, best, least), np.where(is_thin, thinner, closeness)
        found = found | is_thin
    return Thin(found, least, closeness)
