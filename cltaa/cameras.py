"""Camera motion between two frames as the matrix that the kernels apply (docs/conventions.md, Matrices)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.exr.layout import Layout
from cltaa.frames import Camera, Matrix

# Depth of the sky as closeness: 1/Z is exactly 0; -Z has no such value, so the farthest usable one stands for it.
SKY_PERSPECTIVE = 0.0
SKY_ORTHOGRAPHIC = -(2.0**50)

_XYW = np.array([0, 1, 3])  # rows of a matrix over clip space


class Displacement(NamedTuple):
    """Rows x, y, w of D (columns px, py, closeness, 1) and the change of closeness, float64; all zero for no motion."""

    rows: NDArray[np.float64]  # [3, 4]
    closeness: NDArray[np.float64]  # [4], orthographic cameras only


def sky_closeness(camera: Camera) -> float:
    """The closeness that stands for a direction at infinity."""
    return SKY_ORTHOGRAPHIC if camera.orthographic else SKY_PERSPECTIVE


def closeness(depth: NDArray[np.float32], camera: Camera, out: NDArray[np.float32]) -> None:
    """Planar depth [H, W] as closeness, into ``out``: 1/Z, or -Z for an orthographic camera; sky as ``sky_closeness``.

    Depth that is no distance (NaN; 0 or less before a perspective camera) counts as sky.
    """
    if camera.orthographic:
        np.negative(depth, out=out)
        out[~np.isfinite(depth)] = SKY_ORTHOGRAPHIC
        return
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        np.divide(np.float32(1.0), depth, out=out)
        # 1/inf is 0 already; what is negative, infinite or NaN, which min and max hand on, there seldom is.
        if not (out.min(initial=0.0) >= 0.0 and out.max(initial=0.0) < np.inf):
            out[~((out >= 0.0) & (out < np.inf))] = SKY_PERSPECTIVE


def closeness_at(reversed_depth: float, camera: Camera) -> float:
    """Closeness 1/Z of a perspective camera's (1 - z_ndc) / 2: 1 at the near plane, 0 at the far one."""
    _, _, by_z, constant = camera.view_to_clip[2]
    return float((1.0 - 2.0 * reversed_depth + by_z) / constant)


def of_region(camera: Camera, layout: Layout) -> Camera:
    """The camera of a file's picture from that of its display window: the same view, clip space moved and scaled."""
    if layout.data_window == layout.display_window:
        return camera
    (columns, rows), (left, top, *_) = layout.display_size, layout.region
    region = np.eye(4)
    region[0, 0], region[0, 3] = columns / layout.width, (columns - 2 * left) / layout.width - 1.0
    region[1, 1], region[1, 3] = rows / layout.height, 1.0 - (rows - 2 * top) / layout.height
    return Camera(camera.world_to_view, region @ camera.view_to_clip)


def is_still(camera: Camera, previous: Camera) -> bool:
    """True when both matrices are the same, to the bit: then nothing moves, and D is exactly zero."""
    # As lists: a frame waits for this, and nothing of NumPy is in a cache then.
    return bool(
        camera.world_to_view.tolist() == previous.world_to_view.tolist()
        and camera.view_to_clip.tolist() == previous.view_to_clip.tolist()
    )


def displacement(camera: Camera, previous: Camera, width: int, height: int) -> Displacement:
    """D between two frames, in pixels from the image centre (x right, y down), computed camera-relative in float64.

    With p = (px, py, closeness, 1) the previous position is (p_xy + D_xy p) / (1 + D_w p).
    """
    if is_still(camera, previous):
        return Displacement(np.zeros((3, 4)), np.zeros(4))
    view = _view_position(camera, 2.0 / width, -2.0 / height)
    moved = _relative_change(camera, previous) @ view
    # Each part is a difference before anything is multiplied: what does not change leaves exactly nothing behind.
    zoomed = (previous.view_to_clip - camera.view_to_clip) @ view
    rows = previous.view_to_clip @ moved + zoomed
    rows[0] *= width / 2.0
    rows[1] *= -height / 2.0
    return Displacement(rows[_XYW], moved[2] if camera.orthographic else np.zeros(4))


def _view_position(camera: Camera, ndc_x: float, ndc_y: float) -> Matrix:
    """Homogeneous view-space position as a linear function of (px, py, closeness, 1), [4, 4]; NDC = ndc_x px, ndc_y py.

    Perspective: the position divided by depth, (ray, -1) with w = closeness. Orthographic: the position itself, w = 1.
    """
    (xx, xy, xz, x1), (yx, yy, yz, y1), *_ = camera.view_to_clip.tolist()
    if xy == yx == 0.0:
        xx, yy = 1.0 / xx, 1.0 / yy
        by_z, by_1 = (xx * xz, yy * yz), (xx * x1, yy * y1)
    else:
        across = np.linalg.inv(camera.view_to_clip[:2, :2])
        (xx, xy), (yx, yy) = across.tolist()
        by_z, by_1 = ((across @ camera.view_to_clip[:2, column]).tolist() for column in (2, 3))
    x, y = (xx * ndc_x, xy * ndc_y), (yx * ndc_x, yy * ndc_y)
    if camera.orthographic:
        return np.array(
            [[*x, -by_z[0], -by_1[0]], [*y, -by_z[1], -by_1[1]], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
        )
    return np.array([[*x, -by_1[0], by_z[0]], [*y, -by_1[1], by_z[1]], [0.0, 0.0, 0.0, -1.0], [0.0, 0.0, 1.0, 0.0]])


def _relative_change(camera: Camera, previous: Camera) -> Matrix:
    """What takes a position seen by ``camera`` to ``previous``, minus the identity; world positions never appear."""
    now, then = camera.world_to_view[:3, :3], previous.world_to_view[:3, :3]
    change = np.zeros((4, 4))
    change[:3, :3] = (then - now) @ np.linalg.inv(now)
    views = np.array((camera.world_to_view, previous.world_to_view))
    towards = np.linalg.solve(views[:, :3, :3], views[:, :3, 3:])  # the world's origin, seen from each of the two
    change[:3, 3] = then @ (towards[1, :, 0] - towards[0, :, 0])
    return change
