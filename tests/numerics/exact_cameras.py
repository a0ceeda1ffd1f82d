"""Where a pixel's surface was in the previous frame, in 64-bit mantissas and by the plain way through the world."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.frame import Camera

Exact = NDArray[np.longdouble]


def inverse(matrix: NDArray[Any]) -> Exact:
    """Inverse of a 3 x 3 matrix by cofactors, in long double."""
    m = matrix.astype(np.longdouble)
    cofactors = np.array([np.cross(m[1], m[2]), np.cross(m[2], m[0]), np.cross(m[0], m[1])])
    exact: Exact = cofactors.T / np.dot(m[0], cofactors[0])
    return exact


def rotation(axis: tuple[float, float, float], degrees: float) -> NDArray[np.float64]:
    """Rotation matrix about an axis (Rodrigues)."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    turned: NDArray[np.float64] = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)
    return turned


def view_at(position: NDArray[Any], turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """World to view of a camera at ``position`` [3]."""
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = turn, -turn @ position
    return view


def perspective(aspect: float, near: float = 0.1, far: float = 1000.0, zoom: float = 1.7) -> NDArray[np.float64]:
    """OpenGL projection; an infinite ``far`` and a ``near`` beyond ``far`` (reversed) are allowed."""
    clip = np.zeros((4, 4))
    clip[0, 0], clip[1, 1], clip[3, 2] = zoom / aspect, zoom, -1.0
    clip[2, 2], clip[2, 3] = (
        (-1.0, -2.0 * near)
        if np.isinf(far)
        else (
            (far + near) / (near - far),
            2 * far * near / (near - far),
        )
    )
    return clip


def orthographic(half_width: float, half_height: float, near: float = 0.1, far: float = 100.0) -> NDArray[np.float64]:
    """OpenGL parallel projection."""
    clip = np.diag([1 / half_width, 1 / half_height, -2 / (far - near), 1.0])
    clip[2, 3] = -(far + near) / (far - near)
    return clip


def displacement_of(
    px: NDArray[Any],
    py: NDArray[Any],
    inverse_depth: NDArray[Any],
    camera: Camera,
    previous: Camera,
    width: int,
    height: int,
) -> tuple[Exact, Exact, Exact]:
    """Displacement in pixels and distance before the previous camera over the one now.

    ``px``, ``py``: pixels from the image's centre, x right, y down; ``inverse_depth``: 1/Z, or -Z where orthographic.
    """
    kind = np.longdouble

    def off(column: Exact) -> Exact:
        return column[:, None, None]

    n = np.array([px.astype(kind) * 2 / width, -py.astype(kind) * 2 / height])
    clip, then = camera.view_to_clip.astype(kind), previous.view_to_clip.astype(kind)
    turn, before = camera.world_to_view.astype(kind), previous.world_to_view.astype(kind)
    q = inverse_depth.astype(kind)
    across = np.linalg.inv(camera.view_to_clip[:2, :2]).astype(kind)
    if camera.orthographic:
        position = np.array([*np.tensordot(across, n - off(clip[:2, 3]) - off(clip[:2, 2]) * q, 1), q])
        weight: Any = kind(1)
    else:  # the position over its distance, so that the sky (inverse depth 0) is a direction
        position = np.array([*np.tensordot(across, n + off(clip[:2, 2]) - off(clip[:2, 3]) * q, 1), -np.ones_like(q)])
        weight = q
    world = np.tensordot(inverse(turn[:3, :3]), position - turn[:3, 3][:, None, None] * weight, 1)
    earlier = np.tensordot(before[:3, :3], world, 1) + before[:3, 3][:, None, None] * weight
    homogeneous = np.array([*earlier, np.broadcast_to(weight, q.shape)])
    x, y, _, w = np.tensordot(then, homogeneous, 1)
    return (x / w - n[0]) * width / 2, -(y / w - n[1]) * height / 2, w
