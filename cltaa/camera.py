"""Camera motion between two frames as the matrix that the kernels apply (docs/conventions.md, Matrices)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.frame import Camera

# Inverse depth of the sky. Perspective: 1/Z is exactly 0. Orthographic: -Z has no limit, so the farthest usable value.
SKY_PERSPECTIVE = 0.0
SKY_ORTHOGRAPHIC = -(2.0**50)

Rows = list[list[float]]  # of a matrix
Array = NDArray[np.float64]
Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
_NONE = [0.0] * 4


class Displacement(NamedTuple):
    """Rows x, y, w of D (columns px, py, inverse depth, 1) and the change of inverse depth; all zero for no motion."""

    rows: NDArray[np.float64]  # [3, 4]
    inverse_depth: NDArray[np.float64]  # [4], orthographic cameras only


def sky_inverse_depth(camera: Camera) -> float:
    """Return the inverse depth of the sky."""
    return SKY_ORTHOGRAPHIC if camera.orthographic else SKY_PERSPECTIVE


def inverse_depth(depth: NDArray[np.float32], out: NDArray[np.float32], *, parallel: bool) -> None:
    """Convert planar depth [H, W] into ``out``: 1/Z, or -Z for a ``parallel`` projection; the twin of
    ``kernels/arrays.cl``. Invalid depth (NaN; 0 or less for a perspective projection) becomes sky."""
    if parallel:
        np.negative(depth, out=out)
        out[~np.isfinite(depth)] = SKY_ORTHOGRAPHIC
        return
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        np.divide(np.float32(1.0), depth, out=out)
        # 1/inf is already 0. Negative, infinite and NaN results are rare; min and max propagate NaN, so this finds all.
        if not (out.min(initial=0.0) >= 0.0 and out.max(initial=0.0) < np.inf):
            out[~((out >= 0.0) & (out < np.inf))] = SKY_PERSPECTIVE


def inverse_depth_at(reversed_depth: float, camera: Camera) -> float:
    """Inverse depth 1/Z of a perspective camera's (1 - z_ndc) / 2: 1 at the near plane, 0 at the far one."""
    _, _, by_z, constant = camera.view_to_clip[2]
    return float((1.0 - 2.0 * reversed_depth + by_z) / constant)


def is_still(camera: Camera, previous: Camera) -> bool:
    """True when both matrices are equal to the bit: then nothing moves, and D is exactly zero."""
    # Compares lists: this is on the frame's critical path, and NumPy's code is not in a cache then.
    return bool(
        camera.world_to_view.tolist() == previous.world_to_view.tolist()
        and camera.view_to_clip.tolist() == previous.view_to_clip.tolist()
    )


def displacement(camera: Camera, previous: Camera, width: int, height: int) -> Displacement:
    """Return D between two frames, in pixels from the image centre (x right, y down), camera-relative in float64.

    With p = (px, py, inverse depth, 1) the previous position is (p_xy + D_xy p) / (1 + D_w p).
    """
    *rows, closer = displacement_rows(camera, previous, width, height)
    return Displacement(np.array(rows), np.array(closer))


def reprojected(
    x: Array, y: Array, depth: Array, moved: Displacement, *, parallel: bool
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Return the motion u, v to the previous camera, the expected inverse depth there, and what it could see.

    ``x``, ``y`` are pixels from the image centre, ``depth`` is inverse depth; all of one shape, float64.
    """
    dx, dy, dw = (row[0] * x + row[1] * y + row[2] * depth + row[3] for row in moved.rows)
    visible = dw > -1
    w = np.where(visible, 1 + dw, 1.0)
    row = moved.inverse_depth
    expected = depth + (row[0] * x + row[1] * y + row[2] * depth + row[3]) if parallel else depth / w
    return (dx - x * dw) / w, (dy - y * dw) / w, expected, visible


def displacement_rows(camera: Camera, previous: Camera, width: int, height: int) -> Rows:
    """Return the three rows of ``displacement`` and the change of inverse depth, [4][4], in plain Python.

    This is on the frame's critical path, and after the kernels neither NumPy nor LAPACK is in a cache.
    """
    now, then = camera.view_to_clip.tolist(), previous.view_to_clip.tolist()
    here, there = camera.world_to_view.tolist(), previous.world_to_view.tolist()
    if now == then and here == there:
        return [_NONE] * 4
    parallel = now[3][2] == 0.0
    view = _view_position(now, 2.0 / width, -2.0 / height, parallel=parallel)
    change = _relative_change(here[:3], there[:3])
    moved = [[x * a + y * b + z * c + w * d for x, y, z, w in change] for a, b, c, d in view]
    rows: Rows = []
    for row, scale in ((0, width / 2.0), (1, -height / 2.0), (3, 1.0)):
        x, y, z, _ = then[row]
        by = [x * p + y * q + z * r + 0.0 for p, q, r in moved]  # never -0.0
        if now[row] != then[row]:
            # Subtracts before it multiplies, so that unchanged parts contribute exactly 0.
            zoomed = [one - other for one, other in zip(then[row], now[row], strict=True)]
            by = [one + _dot(zoomed, place) for one, place in zip(by, view, strict=True)]
        rows.append([scale * one for one in by])
    return [*rows, [closer for _, _, closer in moved] if parallel else _NONE]


def _view_position(clip: Rows, ndc_x: float, ndc_y: float, *, parallel: bool) -> list[Four]:
    """Return the view-space position by px, by py, by inverse depth and by 1, [4][4]; NDC = ndc_x px, ndc_y py.

    Homogeneous. Perspective: (ray, -1) with w = inverse depth. Orthographic: the position itself, w = 1.
    """
    (xx, xy, xz, x1), (yx, yy, yz, y1), *_ = clip
    size = xx * yy - xy * yx
    xx, xy, yx, yy = yy / size, -xy / size, -yx / size, xx / size
    by_x, by_y = (xx * ndc_x, yx * ndc_x, 0.0, 0.0), (xy * ndc_y, yy * ndc_y, 0.0, 0.0)
    by_z, by_1 = (xx * xz + xy * yz, yx * xz + yy * yz), (xx * x1 + xy * y1, yx * x1 + yy * y1)
    if parallel:
        return [by_x, by_y, (-by_z[0], -by_z[1], 1.0, 0.0), (-by_1[0], -by_1[1], 0.0, 1.0)]
    return [by_x, by_y, (-by_1[0], -by_1[1], 0.0, 1.0), (*by_z, -1.0, 0.0)]


def _relative_change(now: Rows, then: Rows) -> list[Four]:
    """Return the transform from view ``now`` [3][4] to ``then``, minus the identity, without world positions."""
    (here, inverse), (there, _) = _origin(now), _origin(then)
    apart = (there[0] - here[0], there[1] - here[1], there[2] - here[2], 0.0)
    change: list[Four] = []
    for before, after in zip(then, now, strict=True):
        x, y, z = before[0] - after[0], before[1] - after[1], before[2] - after[2]
        by_x, by_y, by_z = [x * p + y * q + z * r for p, q, r in inverse]
        change.append((by_x, by_y, by_z, _dot(before, apart)))
    return change


def _origin(view: Rows) -> tuple[list[float], list[Three]]:
    """Return the world's origin relative to the camera, along the world's axes, and the columns of the inverse."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z) = view
    first = (e * i - f * h, f * g - d * i, d * h - e * g)
    second = (c * h - b * i, a * i - c * g, b * g - a * h)
    third = (b * f - c * e, c * d - a * f, a * e - b * d)
    size = a * first[0] + b * first[1] + c * first[2]
    inverse = [(p / size, q / size, r / size) for p, q, r in (first, second, third)]
    return [p * x + q * y + r * z for p, q, r in zip(*inverse, strict=True)], inverse


def _dot(one: Sequence[float], other: Four) -> float:
    """Sum in double precision from the left, the same on every machine; a BLAS sums in another order on each."""
    a, b, c, d = one
    x, y, z, w = other
    return a * x + b * y + c * z + d * w
