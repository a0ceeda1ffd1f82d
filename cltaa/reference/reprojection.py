"""Twin of ``taa/reprojection.h``: where a surface was in the previous frame."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.constants import value
from cltaa.core.parameters import Dilation, OffScreen
from cltaa.core.planes import Layout
from cltaa.reference.neighbourhood import Surface
from cltaa.reference.real import Array, Mask, Run, greater, number, outside_domain, quiet


class Motion(NamedTuple):
    """Displacement in pixels; previous inverse depth = inverse depth * scale + shift; ``visible`` where the previous
    frame saw the point."""

    u: Array
    v: Array
    scale: Array
    shift: Array
    visible: Mask


def pixel_grid(layout: Layout, like: Array) -> tuple[Array, Array]:
    """Column and row of each pixel, [H, W]."""
    y, x = np.mgrid[: layout.height, : layout.width]
    return x.astype(like.dtype), y.astype(like.dtype)


def motion_from_depth(s: Surface, build: Build, layout: Layout, frame: Record) -> Motion:
    """Camera motion by the displacement matrix of the frame."""
    zero, one = np.zeros_like(s.centre), np.ones_like(s.centre)
    if not build.steps.camera_motion:
        return Motion(zero, zero, one, zero, np.ones(zero.shape, bool))
    x, y = pixel_grid(layout, zero)
    f = {name: number(frame[name], zero) for name in frame.dtype.fields or ()}
    px, py, q = (x + s.x) + f["origin_x"], (y + s.y) + f["origin_y"], s.inverse_depth
    dx = ((f["xx"] * px + f["xy"] * py) + f["xq"] * q) + f["x1"]
    dy = ((f["yx"] * px + f["yy"] * py) + f["yq"] * q) + f["y1"]
    dw = ((f["wx"] * px + f["wy"] * py) + f["wq"] * q) + f["w1"]
    w = one + dw
    visible = w > value("LEAST_W")
    safe_w = np.where(visible, w, one)
    u, v = (dx - px * dw) / safe_w, (dy - py * dw) / safe_w
    if build.steps.orthographic:
        shift = (f["zx"] * px + f["zy"] * py) + f["z1"]
        return Motion(u, v, np.broadcast_to(number(1.0, zero) + f["zq"], zero.shape), shift, visible)
    return Motion(u, v, one / safe_w, zero, visible)


def surface_motion(s: Surface, run: Run) -> Motion:
    """The vector of the motion channel where it holds one, the camera's motion elsewhere."""
    m = motion_from_depth(s, run.build, run.layout, run.frame)
    if run.steps.own_motion:
        camera_only = outside_domain(s.u) | outside_domain(s.v)
        m = Motion(
            np.where(camera_only, m.u, s.u),
            np.where(camera_only, m.v, s.v),
            np.where(camera_only, m.scale, 1.0),
            np.where(camera_only, m.shift, 0.0),
            m.visible | ~camera_only,
        )
    if run.choices.dilation is Dilation.BESIDE:
        x, y = pixel_grid(run.layout, m.u)
        beyond = (x + s.x < 0.0) | (y + s.y < 0.0)
        m = m._replace(u=np.where(beyond, 0.0, m.u), v=np.where(beyond, 0.0, m.v))
    return m


def is_camera_motion(u: Array, v: Array, inverse_depth: Array, by: tuple[Any, Any], run: Run) -> Mask:
    """True where the vector (u, v) is the camera's motion of a point beside the sample, at the sample's depth."""
    x, y = (np.full_like(inverse_depth, each) for each in by)
    rest = (inverse_depth,) * 6
    m = motion_from_depth(Surface(x, y, *rest), run.build, run.layout, run.frame)
    off, length = greater(np.abs(u - m.u), np.abs(v - m.v)), greater(np.abs(u), np.abs(v))
    allowed = number(value("CAMERA_TOLERANCE"), u) + number(value("CAMERA_SHARE"), u) * length
    visible: Mask = m.visible
    return visible & (off <= allowed)


@quiet
def own_motion_kernel(
    build: Build, layout: Layout, *, inverse_depth: Array, motion: Array, own: Array, frame: Record
) -> None:
    """Twin of ``own_motion.cl``: keep in ``own`` the vectors that depth and camera do not explain."""
    run, (u, v), depth = Run(build, layout, frame), layout.inside(motion), layout.inside(inverse_depth)[0]
    depth = np.where(outside_domain(depth), frame["sky_inverse_depth"], depth)
    centre = -frame["jitter_x"], -frame["jitter_y"]
    camera = is_camera_motion(u, v, depth, (0.0, 0.0), run) | is_camera_motion(u, v, depth, centre, run)
    dropped = camera & ~(outside_domain(u) | outside_domain(v))
    layout.inside(own)[...] = np.where(dropped, np.float32(np.inf), np.stack([u, v]))


def _to_edge(position: Array, by: Array, last: Any) -> Array:
    there = position + by
    shortened = np.where(there > last, last - position, by)
    return np.where(there < 0.0, -position, shortened)


def motion_to_edge(m: Motion, run: Run) -> Motion:
    """Shorten displacements that end outside the image to its edge, if the build reads history at the edge there."""
    if run.choices.off_screen is OffScreen.FRESH:
        return m
    x, y = pixel_grid(run.layout, m.u)
    far = value("MOTION_LIMIT")
    near = (np.abs(m.u) < far) & (np.abs(m.v) < far)
    u = np.where(near, _to_edge(x, m.u, run.layout.width - 1), m.u)
    v = np.where(near, _to_edge(y, m.v, run.layout.height - 1), m.v)
    return Motion(u, v, m.scale, m.shift, m.visible)
