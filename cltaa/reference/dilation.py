"""Twin of ``taa/dilation.h``: dilation beyond the 3x3, as in two engines."""

from __future__ import annotations

import numpy as np

from cltaa.core.parameters import Dilation
from cltaa.reference.neighbourhood import Surface, inverse_depth_or_sky
from cltaa.reference.real import NEIGHBOURS, Array, Mask, Run, limit, neighbour
from cltaa.reference.reprojection import pixel_grid

CORNERS = [(-2, 2), (2, 2), (-2, -2), (2, -2)]


def borrowed_surface(s: Surface, inverse_depth: Array, motion: Array | None, run: Run) -> Surface:
    """The surface of each pixel itself, ``s``, or of the texel whose motion it borrows, from padded planes [1, rows,
    stride] and [2, rows, stride]."""
    kind = run.choices.dilation
    if kind not in (Dilation.CORNERS, Dilation.BESIDE):
        return s
    like = s.centre

    def inverse_depth_at(dx: int, dy: int) -> Array:
        return inverse_depth_or_sky(neighbour(inverse_depth[0], dx, dy, run.layout).astype(like.dtype), run.frame)

    def take_texel(s: Surface, where: Mask, dx: int, dy: int) -> Surface:
        u, v = s.u, s.v
        if motion is not None and run.steps.own_motion:
            u, v = neighbour(motion, dx, dy, run.layout).astype(like.dtype)
        return s._replace(
            inverse_depth=np.where(where, inverse_depth_at(dx, dy), s.inverse_depth),
            x=np.where(where, dx, s.x),
            y=np.where(where, dy, s.y),
            u=np.where(where, u, s.u),
            v=np.where(where, v, s.v),
        )

    nearest, by, places = s.centre, 0, CORNERS
    if kind is Dilation.BESIDE:
        nearest, by, places = np.full_like(like, run.frame["sky_inverse_depth"]), -1, NEIGHBOURS
        s = take_texel(s, np.ones(like.shape, bool), -1, -1)
    for dx, dy in places:
        q = inverse_depth_at(dx, dy)
        nearer = q > nearest
        nearest = np.where(nearer, q, nearest)
        s = take_texel(s, nearer, dx + by, dy + by)
    if kind is Dilation.BESIDE:
        return s
    x, y = pixel_grid(run.layout, like)
    return s._replace(x=limit(x + s.x, 0.0, run.layout.width - 1) - x, y=limit(y + s.y, 0.0, run.layout.height - 1) - y)
