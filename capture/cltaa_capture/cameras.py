"""Camera matrices, float64: the un-jittered ones for files, and those for the rasteriser.

The rasteriser uses reversed depth (1 near, 0 at infinity), for which float32 has nearly constant relative precision:
Reed, "Depth Precision Visualized" (2015). Only the third row of the projection differs from the written matrix.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cltaa.frame import Camera, Matrix
from cltaa_datasets.scene import Instant, Lens, Orthographic


def view_to_clip(lens: Lens, aspect: float) -> Matrix:
    """Return the projection to OpenGL clip space; ``aspect`` is width / height. A perspective lens has no far plane."""
    matrix = np.zeros((4, 4))
    if isinstance(lens, Orthographic):
        depth = lens.far - lens.near
        matrix[[0, 1, 3], [0, 1, 3]] = 1.0 / (aspect * lens.half_height), 1.0 / lens.half_height, 1.0
        matrix[2, 2:] = -2.0 / depth, -(lens.far + lens.near) / depth
    else:
        focal = 1.0 / np.tan(lens.field_of_view / 2.0)
        matrix[[0, 1], [0, 1]] = focal / aspect, focal
        # The limit of the usual rows for far -> infinity.
        matrix[2, 2:] = -1.0, -2.0 * lens.near
        matrix[3, 2] = -1.0
    return matrix


def camera_at(instant: Instant, aspect: float) -> Camera:
    """Return the un-jittered camera of a scene at one time."""
    return Camera(world_to_view=instant.world_to_view, view_to_clip=view_to_clip(instant.lens, aspect))


def reversed_projection(lens: Lens, aspect: float) -> Matrix:
    """Return ``view_to_clip`` with depth 1 at ``near`` and 0 at infinity (parallel lens: at ``far``)."""
    matrix = view_to_clip(lens, aspect)
    if isinstance(lens, Orthographic):
        matrix[2, 2:] = 1.0 / (lens.far - lens.near), lens.far / (lens.far - lens.near)
    else:
        matrix[2, 2:] = 0.0, lens.near
    return matrix


def planar_depth(device_depth: NDArray[np.float32], lens: Lens) -> NDArray[np.float32]:
    """Convert reversed depth [H, W] to distance along the view axis; +inf where nothing was drawn (0)."""
    device = device_depth.astype(np.float64)
    with np.errstate(divide="ignore"):
        if isinstance(lens, Orthographic):
            planar = np.where(device == 0.0, np.inf, lens.far - device * (lens.far - lens.near))
        else:
            # The device uses the near distance rounded to float32; any other dividend would shift every depth.
            planar = np.float64(np.float32(lens.near)) / device
    return planar.astype(np.float32)


def jitter_ndc(jitter_px: tuple[float, float], width: int, height: int) -> tuple[float, float]:
    """Return the shift of the picture, in NDC, that places each pixel's sample at its centre plus ``jitter_px``.

    ``P_jittered = T(-2 jx / W, +2 jy / H) P``: the picture moves opposite to the sample, and NDC y points up.
    """
    return -2.0 * jitter_px[0] / width, 2.0 * jitter_px[1] / height


def clip_to_world_direction(camera: Camera) -> Matrix:
    """Return the 3x3 matrix from (ndc_x, ndc_y, 1) to the world direction seen there, not normalised."""
    projection, view_to_world = camera.view_to_clip, camera.world_to_view[:3, :3].T
    ray = np.zeros((3, 3))
    if not camera.orthographic:
        # Invert x_ndc = (P00 x + P02 z) / -z at z = -1.
        ray[0] = 1.0 / projection[0, 0], 0.0, projection[0, 2] / projection[0, 0]
        ray[1] = 0.0, 1.0 / projection[1, 1], projection[1, 2] / projection[1, 1]
    ray[2, 2] = -1.0
    return view_to_world @ ray
