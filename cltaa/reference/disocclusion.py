"""Twin of ``taa/disocclusion.h``: where the previous frame did not show the surface, there is no history of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from cltaa.core.planes import Layout
from cltaa.reference.neighbourhood import Surface
from cltaa.reference.real import Array, Mask, constant, greater, number
from cltaa.reference.reprojection import Motion, pixel_grid
from cltaa.reference.sampling import Quad


def on_screen(m: Motion, layout: Layout) -> Mask:
    """True where the previous position lies inside the image and is closer than MOTION_LIMIT."""
    x, y = pixel_grid(layout, m.u)
    half, far = number(0.5, m.u), constant("MOTION_LIMIT", m.u)
    hx, hy = x + m.u, y + m.v
    right, bottom = number(layout.width, m.u) - half, number(layout.height, m.u) - half
    inside = (hx >= -half) & (hy >= -half) & (hx <= right) & (hy <= bottom)
    near: Mask = m.visible & inside & (np.abs(m.u) < far) & (np.abs(m.v) < far)
    return near


def surface_range(s: Surface, m: Motion, tolerance: Any) -> tuple[Array, Array]:
    """Lowest and highest inverse depth of the current 3x3, seen from the previous camera and widened."""
    near, far = s.nearest * m.scale + m.shift, s.farthest * m.scale + m.shift
    slack = number(tolerance, near) * greater(np.abs(near), np.abs(far))
    return far - slack, near + slack


def same_surface(previous: Quad, s: Surface, m: Motion, tolerance: Any) -> Mask:
    """True where one of four texels of the previous inverse depth lies in the range of the current 3x3."""
    low, high = surface_range(s, m, tolerance)
    matches = [(p <= high) & (p >= low) for p in previous]
    result: Mask = matches[0] | matches[1] | matches[2] | matches[3]
    return result


def partly_covered(previous: Quad, s: Surface, m: Motion, tolerance: Any) -> Mask:
    """True where one of four texels of the previous inverse depth is nearer than all of the current 3x3."""
    _, high = surface_range(s, m, tolerance)
    nearer = [p > high for p in previous]
    result: Mask = nearer[0] | nearer[1] | nearer[2] | nearer[3]
    return result
