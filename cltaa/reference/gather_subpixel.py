"""Twin of ``gather/subpixel.h``: sub-pixel features, which the samples of one frame hit here and miss there."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.planes import Layout
from cltaa.reference.disocclusion import on_screen
from cltaa.reference.gather_sides import NEIGHBOURS, Layers
from cltaa.reference.gather_track import RING_INVERSE_DEPTH, RING_MOTION, no_motion_vector, texel_at
from cltaa.reference.neighbourhood import Surface, inverse_depth_or_sky
from cltaa.reference.real import Array, Mask, constant, greater, number
from cltaa.reference.reprojection import motion_from_depth
from cltaa.reference.sampling import footprint_of


class SubpixelFeature(NamedTuple):
    """What was found of things that the 3x3 of now misses: whether, how far off the centre, and how close it is."""

    found: Mask
    off: Array
    inverse_depth: Array


def find_subpixel_feature(
    s: Surface, layers: Layers, ring: Array, past: Any, build: Build, layout: Layout, settings: Record
) -> tuple[Surface, Layers]:
    """``s`` and ``layers`` with the surface that the latest frames in the ring show in front of all that the 3x3 shows
    now, where it now lies near the pixel's centre and the camera alone moves it."""
    zero, half = np.zeros_like(s.centre), number(0.5, s.centre)
    open_here = ~layers.edge & no_motion_vector(s.u, s.v) if build.steps.own_motion else ~layers.edge
    wanted = int(settings["subpixel_frames"])
    latest = past[:wanted]
    if build.steps.look_ahead:
        latest = [then for then in past if abs(int(then["ahead"])) <= wanted]
    feature = search_subpixel_feature(open_here, s, ring, latest, build, layout, settings)
    slope_x, slope_y = (np.where(feature.found, zero, slope) for slope in layers.slope)
    cut = np.where(feature.found, half * (feature.inverse_depth + s.nearest), layers.cut)
    nearest = np.where(feature.found, feature.inverse_depth, s.nearest)
    edge = layers.edge | feature.found
    return s._replace(inverse_depth=feature.inverse_depth, nearest=nearest), Layers(edge, cut, (slope_x, slope_y))


def search_subpixel_feature(
    open_here: Mask, s: Surface, ring: Array, past: Any, build: Build, layout: Layout, settings: Record
) -> SubpixelFeature:
    """What the frames in the ring ``past`` show near the pixel in front of all that the 3x3 shows now of ``s``."""
    zero, half = np.zeros_like(s.centre), number(0.5, s.centre)
    found, least, inverse_depth = (
        np.zeros(zero.shape, bool),
        np.full_like(zero, constant("SUBPIXEL_REACH", zero)),
        s.inverse_depth,
    )
    real: Any = zero.dtype
    own_motion = build.steps.own_motion
    for then in past:
        planes = ring[int(then["slot"])]
        m = motion_from_depth(s, build, layout, then)
        seen = open_here & on_screen(m, layout)
        u = m.u + (half - number(then["jitter_x"], zero))
        v = m.v + (half - number(then["jitter_y"], zero))
        f = footprint_of(m._replace(u=u, v=v), seen, layout)
        near = s.nearest * m.scale + m.shift
        high = near + number(settings["depth_tolerance"], zero) * np.abs(near)
        hits, best, thinner = zero, least, inverse_depth
        for dx, dy in NEIGHBOURS:
            there = f._replace(row=f.row + dy, column=f.column + dx)
            q = inverse_depth_or_sky(texel_at(planes[RING_INVERSE_DEPTH], there, real), then)
            nearer = seen & (q > high)
            hit = s._replace(inverse_depth=(q - m.shift) / m.scale)
            way = motion_from_depth(hit, build, layout, then)
            ox = ((half - f.fx) + number(dx, zero)) + (m.u - way.u)
            oy = ((half - f.fy) + number(dy, zero)) + (m.v - way.v)
            off = greater(np.abs(ox), np.abs(oy))
            hits = hits + np.where(nearer, number(1.0, zero), zero)
            if own_motion:
                nearer = nearer & no_motion_vector(
                    *(texel_at(planes[RING_MOTION + axis], there, real) for axis in (0, 1))
                )
            here = nearer & way.visible & (off < best)
            best, thinner = np.where(here, off, best), np.where(here, hit.inverse_depth, thinner)
        is_subpixel = (best < least) & (hits <= constant("SUBPIXEL_HITS", zero))
        least, inverse_depth = np.where(is_subpixel, best, least), np.where(is_subpixel, thinner, inverse_depth)
        found = found | is_subpixel
    return SubpixelFeature(found, least, inverse_depth)
