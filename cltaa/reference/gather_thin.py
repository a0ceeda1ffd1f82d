"""Twin of ``gather_thin.h``: things thinner than a pixel, which the samples of one frame hit here and miss there."""

from __future__ import annotations

from typing import Any

import numpy as np

from cltaa.build import Build, Record
from cltaa.layout import Layout
from cltaa.reference.gather_sides import NEIGHBOURS, Layers
from cltaa.reference.gather_track import KEPT_CLOSENESS, KEPT_MOTION, texel_at, untold
from cltaa.reference.neighbourhood import Surface, usable_closeness
from cltaa.reference.projection import motion_from_depth, on_screen
from cltaa.reference.real import Array, constant, greater, number
from cltaa.reference.sampling import footprint_of


def recall_thin(
    s: Surface, layers: Layers, kept: Array, past: Any, build: Build, layout: Layout, settings: Record
) -> tuple[Surface, Layers]:
    """``s`` and ``layers`` with the surface that the latest kept frames show in front of all that the 3x3 shows now,
    where it now lies near the pixel's centre and the camera alone moves it."""
    zero, half = np.zeros_like(s.centre), number(0.5, s.centre)
    real: Any = zero.dtype
    none = np.zeros(zero.shape, bool)
    own_motion = build.steps.own_motion
    open_here = ~layers.edge & (untold(s.u, s.v) if own_motion else ~none)
    least, closeness, found = np.full_like(zero, constant("THIN_REACH", zero)), s.closeness, none
    for then in past[: int(settings["thin_frames"])]:
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
            beside = f._replace(row=f.row + dy, column=f.column + dx)
            q = usable_closeness(texel_at(planes[KEPT_CLOSENESS], beside, real), then)
            nearer = seen & (q > high)
            hits = hits + np.where(nearer, number(1.0, zero), zero)
            if own_motion:
                nearer = nearer & untold(*(texel_at(planes[KEPT_MOTION + axis], beside, real) for axis in (0, 1)))
            thin = s._replace(closeness=(q - m.shift) / m.scale)
            way = motion_from_depth(thin, build, layout, then)
            ox = ((half - f.fx) + number(dx, zero)) + (m.u - way.u)
            oy = ((half - f.fy) + number(dy, zero)) + (m.v - way.v)
            off = greater(np.abs(ox), np.abs(oy))
            here = nearer & way.visible & (off < best)
            best, thinner = np.where(here, off, best), np.where(here, thin.closeness, thinner)
        is_thin = (best < least) & (hits <= constant("THIN_HITS", zero))
        least, closeness = np.where(is_thin, best, least), np.where(is_thin, thinner, closeness)
        found = found | is_thin
    slope_x, slope_y = (np.where(found, zero, slope) for slope in layers.slope)
    cut = np.where(found, half * (closeness + s.nearest), layers.cut)
    nearest = np.where(found, closeness, s.nearest)
    return s._replace(closeness=closeness, nearest=nearest), Layers(layers.edge | found, cut, (slope_x, slope_y))
