"""Twin of ``taa/disocclusion.h``: rejects history where the previous frame did not show the surface."""

from __future__ import annotations

from typing import Any

import numpy as np

from cltaa.core.constants import value
from cltaa.core.planes import Layout
from cltaa.reference.neighbourhood import Surface, has_edge
from cltaa.reference.real import Array, Mask, Run, greater, limit
from cltaa.reference.reprojection import Motion, motion_from_depth, pixel_grid
from cltaa.reference.sampling import Footprint, Quad, bilinear


def on_screen(m: Motion, layout: Layout) -> Mask:
    """True where the reprojected position lies inside the image and nearer than MOTION_LIMIT."""
    x, y = pixel_grid(layout, m.u)
    hx, hy, far = x + m.u, y + m.v, value("MOTION_LIMIT")
    inside = (hx >= -0.5) & (hy >= -0.5) & (hx <= layout.width - 0.5) & (hy <= layout.height - 0.5)
    return m.visible & inside & (np.abs(m.u) < far) & (np.abs(m.v) < far)


def surface_range(s: Surface, m: Motion, run: Run) -> tuple[Array, Array]:
    """Lowest and highest inverse depth of the current 3x3, seen from the previous camera and widened."""
    near, far = s.nearest * m.scale + m.shift, s.farthest * m.scale + m.shift
    slack = run.settings["depth_tolerance"] * greater(np.abs(near), np.abs(far))
    return far - slack, near + slack


def weighted_texels(q: Quad, f: Footprint) -> Quad:
    """Replace texels of no bilinear weight (a fraction is 0) by the neighbour that has the weight."""
    one_column, one_row = f.fx == 0, f.fy == 0
    p10, p11 = np.where(one_column, q.p00, q.p10), np.where(one_column, q.p01, q.p11)
    return Quad(q.p00, p10, np.where(one_row, q.p00, q.p01), np.where(one_row, p10, p11))


def same_surface(previous: Quad, s: Surface, m: Motion, run: Run) -> Mask:
    """True where one of four texels of the previous inverse depth lies in the range of the current 3x3."""
    low, high = surface_range(s, m, run)
    matches = [(p <= high) & (p >= low) for p in previous]
    return matches[0] | matches[1] | matches[2] | matches[3]


def nearer_than(q: Quad, than: Array) -> Quad:
    """1 for each texel nearer than ``than``, 0 for others."""
    return Quad(*(np.where(p > than, np.ones_like(than), 0.0) for p in q))


def any_nearer(q: Quad, than: Array) -> Mask:
    """True where one of four inverse depths is greater."""
    return (q.p00 > than) | (q.p10 > than) | (q.p01 > than) | (q.p11 > than)


def nearest_of(q: Quad) -> Array:
    """The greatest of four inverse depths."""
    return greater(greater(q.p00, q.p10), greater(q.p01, q.p11))


def parallax_of(other: Array, s: Surface, m: Motion, run: Run) -> Array:
    """Parallax in pixels, by camera motion alone, between the surface and a point of inverse depth ``other``."""
    here = np.zeros_like(s.nearest)
    point = Surface(here, here, other, here, here, here, here, here)
    its = motion_from_depth(point, run.build, run.layout, run.frame)
    if run.steps.own_motion and run.frame["own_vectors"]:
        m = motion_from_depth(point._replace(inverse_depth=s.nearest), run.build, run.layout, run.frame)
    return greater(np.abs(its.u - m.u), np.abs(its.v - m.v))


def has_parallax(other: Array, s: Surface, m: Motion, run: Run) -> Mask:
    """True where that parallax is large enough for one to have passed the other."""
    moved: Mask = parallax_of(other, s, m, run) >= value("LEAST_PARALLAX")
    return moved


def occluder_has_passed(nearest: Array, s: Surface, m: Motion, run: Run) -> Mask:
    """True where the ``nearest`` inverse depth around the history position is nearer than the surface, and has moved
    against it since."""
    _, high = surface_range(s, m, run)
    moved = has_parallax((nearest - m.shift) / m.scale, s, m, run)
    return (nearest > high) & moved


def middle_inverse_depth(s: Surface, m: Motion) -> Array:
    """Middle of the nearest and the farthest inverse depth of the 3x3, seen from the previous camera."""
    middle: Array = 0.5 * (s.nearest + s.farthest) * m.scale + m.shift
    return middle


def shows_background(previous: Quad, s: Surface, m: Motion, run: Run) -> Mask:
    """True where a pixel follows a nearer surface past its own, and three of the four texels at the history position
    did not show that surface either."""
    nearer = nearer_than(previous, middle_inverse_depth(s, m))
    shown = (nearer.p00 + nearer.p10) + (nearer.p01 + nearer.p11)
    moved = has_parallax(s.centre, s, m, run)
    return ((s.x != 0) | (s.y != 0)) & (shown <= 1) & moved


def edge_count_limit(previous: Quad, corners: Quad, s: Surface, m: Motion, run: Run) -> Array:
    """Upper limit of the sample count: low at the edge of a nearer surface, not of a wire, where camera motion has
    moved the background past it."""
    middle = middle_inverse_depth(s, m)
    edge = has_edge(s, run) & any_nearer(previous, middle) & any_nearer(corners, middle)
    parallax, least = parallax_of(s.farthest, s, m, run), value("LEAST_PARALLAX")
    count_limit = run.settings["edge_samples"] / limit(parallax, least, 1)
    return np.where(edge & (parallax >= least), count_limit, value("DOMAIN_LIMIT"))


def occluder_covered(previous: Quad, corners: Quad, high: Array, f: Footprint, covered_share: Any) -> Mask:
    """True where an occluder nearer than ``high`` covered more than ``covered_share`` of the footprint, and a corner of
    the 4x4 around it."""
    share = bilinear(nearer_than(previous, high), f)
    return (share > covered_share) & any_nearer(corners, high)
