"""Twin of ``gather/sides.h`` and ``gather/subpixel.h``: the two sides of a depth edge through the 3x3, and sub-pixel
features in front of it, which the samples of one frame hit and those of another miss."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from cltaa.core.constants import value
from cltaa.reference.colour import Colour, colour_outside_domain, to_range
from cltaa.reference.disocclusion import on_screen
from cltaa.reference.gather_track import MOTION, RING_INVERSE_DEPTH, no_motion_vector, texel_at
from cltaa.reference.neighbourhood import Row, Surface, has_edge, inverse_depth_or_sky
from cltaa.reference.real import NEIGHBOURS, Array, Mask, Run, greater, neighbour, number
from cltaa.reference.reprojection import motion_from_depth
from cltaa.reference.sampling import footprint_of


@dataclass(frozen=True, slots=True)
class Layers:
    """Where an edge runs, the inverse depth that separates its sides, and the slope of inverse depth on the followed
    surface."""

    edge: Mask
    cut: Array
    slope: tuple[Array, Array]

    def on_side(self, inverse_depth: Array, *, far: bool) -> Mask:
        """True for samples of one side of the edge."""
        return self.edge & ((inverse_depth <= self.cut) if far else (inverse_depth > self.cut))


@dataclass(frozen=True, slots=True)
class Side:
    """The surface of one side at its sample nearest to the pixel, and its samples' mean colour and number."""

    surface: Surface
    layers: Layers
    mean: Colour
    count: Array


def layers_of(above: Row, centre: Row, below: Row, s: Surface, run: Run) -> Layers:
    """Where a depth edge runs through the 3x3, the inverse depth that separates its sides, and the slope where no edge
    runs."""
    edge = has_edge(s, run)
    slopes = (0.5 * centre.rise, 0.5 * (below.inverse_depth - above.inverse_depth))
    x, y = (np.where(edge, 0.0, slope) for slope in slopes)
    return Layers(edge, 0.5 * (s.nearest + s.farthest), (x, y))


def side_surface(
    s: Surface, layers: Layers, inverse_depth: Array, motion: Array | None, run: Run, *, far: bool
) -> Surface:
    """The surface at the side's sample nearest to the pixel; of equally near ones the pixel's own row wins."""
    real: Any = s.centre.dtype
    least = np.full_like(s.centre, value("DOMAIN_LIMIT"))
    x, y, q, u, v = s.x, s.y, s.inverse_depth, s.u, s.v
    for dx, dy in NEIGHBOURS:
        z = inverse_depth_or_sky(neighbour(inverse_depth[0], dx, dy, run.layout).astype(real), run.frame)
        away = 2 * dx * dx + 3 * dy * dy
        here = layers.on_side(z, far=far) & (away < least)
        least = np.where(here, away, least)
        x, y, q = np.where(here, dx, x), np.where(here, dy, y), np.where(here, z, q)
        if run.steps.own_motion and motion is not None:
            own_u, own_v = neighbour(motion, dx, dy, run.layout).astype(real)
            u, v = np.where(here, own_u, u), np.where(here, own_v, v)
    return s._replace(x=x, y=y, inverse_depth=q, u=u, v=v)


def side_of(
    s: Surface,
    layers: Layers,
    own: Colour,
    current: Array,
    inverse_depth: Array,
    motion: Array | None,
    run: Run,
    *,
    far: bool,
) -> Side:
    """One side of each pixel that an edge runs through, elsewhere ``s`` unchanged; its slope by least squares."""
    at = side_surface(s, layers, inverse_depth, motion, run, far=far)
    real: Any = s.centre.dtype
    zero = np.zeros_like(s.centre)
    xx = yy = np.full_like(zero, run.settings["fit_ridge"])
    xy = qx = qy = count = zero
    mean = np.zeros_like(own)
    for dx, dy in NEIGHBOURS:
        z = inverse_depth_or_sky(neighbour(inverse_depth[0], dx, dy, run.layout).astype(real), run.frame)
        here = layers.on_side(z, far=far)
        rise = np.where(here, z - at.inverse_depth, zero)
        ox = np.where(here, dx - at.x, zero)
        oy = np.where(here, dy - at.y, zero)
        xx, xy, yy = xx + ox * ox, xy + ox * oy, yy + oy * oy
        qx, qy = qx + ox * rise, qy + oy * rise
        colour = neighbour(current[:3], dx, dy, run.layout).astype(real)
        in_domain = here & ~colour_outside_domain(colour)
        mean = mean + np.where(in_domain, to_range(colour, run.build) - own, zero)
        count = count + np.where(in_domain, 1.0, zero)
    det, among = xx * yy - xy * xy, np.where(count > zero, count, 1.0)
    slope_x = np.where(layers.edge, (yy * qx - xy * qy) / det, layers.slope[0])
    slope_y = np.where(layers.edge, (xx * qy - xy * qx) / det, layers.slope[1])
    return Side(at, replace(layers, slope=(slope_x, slope_y)), own + mean / among, count)


def range_of_side(s: Surface, layers: Layers, *, far: bool) -> Surface:
    """Narrow the surface's range of inverse depth to its own side."""
    if far:
        return s._replace(nearest=np.where(layers.edge, layers.cut, s.nearest))
    return s._replace(farthest=np.where(layers.edge, layers.cut, s.farthest))


class SubpixelFeature(NamedTuple):
    """A feature that the current 3x3 misses: where one was found, its distance from the centre, its inverse depth."""

    found: Mask
    off: Array
    inverse_depth: Array


def find_subpixel_feature(s: Surface, layers: Layers, ring: Array, past: Any, run: Run) -> tuple[Surface, Layers]:
    """Make the surface that the latest frames in the ring show in front of all that the 3x3 shows now the nearer side
    of an edge, where it now lies near the pixel's centre and has no own motion."""
    open_here = ~layers.edge & no_motion_vector(s.u, s.v) if run.steps.own_motion else ~layers.edge
    wanted = int(run.settings["subpixel_frames"])
    latest = past[:wanted]
    if run.steps.look_ahead:
        latest = [then for then in past if abs(int(then["ahead"])) <= wanted]
    feature = search_subpixel_feature(open_here, s, ring, latest, run)
    slope_x, slope_y = (np.where(feature.found, 0.0, slope) for slope in layers.slope)
    cut = np.where(feature.found, 0.5 * (feature.inverse_depth + s.nearest), layers.cut)
    nearest = np.where(feature.found, feature.inverse_depth, s.nearest)
    edge = layers.edge | feature.found
    return s._replace(inverse_depth=feature.inverse_depth, nearest=nearest), Layers(edge, cut, (slope_x, slope_y))


def search_subpixel_feature(open_here: Mask, s: Surface, ring: Array, past: Any, run: Run) -> SubpixelFeature:
    """Search the ring frames ``past`` near the pixel for surfaces in front of all that the 3x3 now shows of ``s``."""
    zero, half = np.zeros_like(s.centre), number(0.5, s.centre)
    found, least, inverse_depth = (
        np.zeros(zero.shape, bool),
        np.full_like(zero, value("SUBPIXEL_REACH")),
        s.inverse_depth,
    )
    real: Any = zero.dtype
    own_motion = run.steps.own_motion
    for then in past:
        planes = ring[int(then["slot"])]
        m = motion_from_depth(s, run.build, run.layout, then)
        seen = open_here & on_screen(m, run.layout)
        u = m.u + (half - number(then["jitter_x"], zero))
        v = m.v + (half - number(then["jitter_y"], zero))
        f = footprint_of(m._replace(u=u, v=v), seen, run.layout)
        near = s.nearest * m.scale + m.shift
        high = near + run.settings["depth_tolerance"] * np.abs(near)
        hits, best, thinner = zero, least, inverse_depth
        for dx, dy in NEIGHBOURS:
            there = f._replace(row=f.row + dy, column=f.column + dx)
            q = inverse_depth_or_sky(texel_at(planes[RING_INVERSE_DEPTH], there, real), then)
            nearer = seen & (q > high)
            hit = s._replace(inverse_depth=(q - m.shift) / m.scale)
            hit_motion = motion_from_depth(hit, run.build, run.layout, then)
            ox = ((half - f.fx) + dx) + (m.u - hit_motion.u)
            oy = ((half - f.fy) + dy) + (m.v - hit_motion.v)
            off = greater(np.abs(ox), np.abs(oy))
            hits = hits + np.where(nearer, 1.0, zero)
            if own_motion:
                nearer = nearer & no_motion_vector(*texel_at(planes[MOTION], there, real))
            here = nearer & hit_motion.visible & (off < best)
            best, thinner = np.where(here, off, best), np.where(here, hit.inverse_depth, thinner)
        is_subpixel = (best < least) & (hits <= value("SUBPIXEL_HITS"))
        least, inverse_depth = np.where(is_subpixel, best, least), np.where(is_subpixel, thinner, inverse_depth)
        found = found | is_subpixel
    return SubpixelFeature(found, least, inverse_depth)
