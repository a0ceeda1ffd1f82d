"""What a graphics interface gives a shader, in plain NumPy: samplers, texel fetches, matrices.

Shared by the transcriptions beside it and by nothing else; shares no code with the project's stages. Pixel positions
are in pixels, x right, y down, texel centres at +0.5 (docs/conventions.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.frame import Camera, Frame

Array = NDArray[Any]  # float64


def halton(base: int, index: int) -> float:
    """Radical inverse of ``index`` >= 1."""
    result, digit = 0.0, 1.0 / base
    while index > 0:
        result += digit * (index % base)
        index //= base
        digit /= base
    return result


def pixel_centres(height: int, width: int) -> tuple[Array, Array]:
    """x and y of the pixel centres, each [H, W]."""
    y, x = np.mgrid[0:height, 0:width] + 0.5
    return x, y


def fetch(image: Array, column: Array, row: Array, border: str = "edge") -> Array:
    """Texels [H, W, C] by whole index; outside, the edge's (``edge``) or zero (``zero``)."""
    height, width = image.shape[:2]
    texels: Array = image[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    if border == "zero":
        outside = (column < 0) | (column >= width) | (row < 0) | (row >= height)
        texels = np.where(outside[..., None], 0.0, texels)
    return texels


def bilinear(image: Array, x: Array, y: Array) -> Array:
    """A LINEAR, CLAMP_TO_EDGE sampler at pixel positions x, y [H, W]."""
    left, top = np.floor(x - 0.5), np.floor(y - 0.5)
    fx, fy = (x - 0.5 - left)[..., None], (y - 0.5 - top)[..., None]
    column, row = left.astype(np.int64), top.astype(np.int64)
    above = fetch(image, column, row) * (1 - fx) + fetch(image, column + 1, row) * fx
    below = fetch(image, column, row + 1) * (1 - fx) + fetch(image, column + 1, row + 1) * fx
    blended: Array = above * (1 - fy) + below * fy
    return blended


def square(image: Array) -> list[Array]:
    """The 3x3 neighbourhood of every pixel as nine images, x in the outer loop, y in the inner."""
    row, column = np.mgrid[0 : image.shape[0], 0 : image.shape[1]]
    return [fetch(image, column + dx, row + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]


def rgb_to_ycocg(rgb: Array) -> Array:
    """Y = R/4 + G/2 + B/4, Co = R/2 - B/2, Cg = -R/4 + G/2 - B/4."""
    r, g, b = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    return np.stack([r / 4 + g / 2 + b / 4, r / 2 - b / 2, -r / 4 + g / 2 - b / 4], axis=-1)


def ycocg_to_rgb(ycocg: Array) -> Array:
    """R = Y + Co - Cg, G = Y + Cg, B = Y - Co - Cg; nothing is cut off."""
    y, co, cg = ycocg[..., 0], ycocg[..., 1], ycocg[..., 2]
    return np.stack([y + co - cg, y + cg, y - co - cg], axis=-1)


def starts_anew(frame: Frame, previous: Frame) -> bool:
    """True where there is no history: a gap in the numbers, another size, or a cut, of which no source knows."""
    return frame.cut or frame.index != previous.index + 1 or frame.colour.shape != previous.colour.shape


def resolved(frames: Iterable[Frame], step: Callable[[Frame, Frame, Array, Array], Array]) -> list[Array]:
    """The images [H, W, 3 or 4] of ``frames``: as drawn where there is no history, else what ``step`` makes of a frame,
    the previous one, this one's colour and the history. Alpha stays as it is."""
    images: list[Array] = []
    previous: Frame | None = None
    history = np.empty(0)
    for frame in frames:
        current = frame.colour.astype(np.float64)
        if previous is None or starts_anew(frame, previous):
            history = current
        else:
            history = step(frame, previous, current, history)
        alpha = [] if frame.alpha is None else [frame.alpha[..., None]]
        images.append(np.concatenate([history, *alpha], axis=-1))
        previous = frame
    return images


def same_camera(camera: Camera, other: Camera) -> bool:
    """True when both matrices are equal."""
    return np.array_equal(camera.world_to_view, other.world_to_view) and np.array_equal(
        camera.view_to_clip, other.view_to_clip
    )


def clip_depth(depth: Array, camera: Camera) -> Array:
    """z in normalised device coordinates (-1 near, 1 far) of planar depth; sky is 1, the far plane."""
    projection = camera.view_to_clip
    with np.errstate(invalid="ignore"):
        z, w = (-depth * projection[row, 2] + projection[row, 3] for row in (2, 3))
        return np.where(np.isfinite(depth), z / w, 1.0)


def reprojected(x: Array, y: Array, z: Array, frame: Frame, previous: Frame) -> tuple[Array, Array]:
    """Pixel positions that the previous frame's camera gives to points at pixel x, y and NDC depth z, by float64.

    ``clip' = P' V' (P V)^-1 ndc``, as every one of the sources computes it; the matrices carry no jitter.
    """
    now = frame.camera.view_to_clip @ frame.camera.world_to_view
    before = previous.camera.view_to_clip @ previous.camera.world_to_view
    ndc = np.stack([2 * x / frame.width - 1, 1 - 2 * y / frame.height, z, np.ones_like(x)], axis=-1)
    clip = ndc.astype(np.float64) @ (before @ np.linalg.inv(now)).T
    ndc_before = clip[..., :2] / clip[..., 3:]
    return (ndc_before[..., 0] + 1) * frame.width / 2, (1 - ndc_before[..., 1]) * frame.height / 2


def velocity_buffer(frame: Frame, previous: Frame) -> Array:
    """The correct velocity of every pixel's own sample, ``prev_px - px`` [H, W, 2], as a G-buffer pass would write it.

    Where the frame has no motion (NaN, or no channel at all) it follows from depth and cameras at the sample's
    position, jitter included in where the sample lies and excluded from how far it moved. The sky lies at infinity.
    """
    x, y = pixel_centres(frame.height, frame.width)
    x, y = x + frame.jitter_px[0], y + frame.jitter_px[1]
    if same_camera(frame.camera, previous.camera):
        by_camera = np.zeros((frame.height, frame.width, 2))
    else:
        before_x, before_y = _at_true_depth(x, y, frame, previous)
        by_camera = np.stack([before_x - x, before_y - y], axis=-1)
    if frame.motion is None:
        return by_camera
    return np.where(np.isnan(frame.motion).any(-1, keepdims=True), by_camera, frame.motion)


def _at_true_depth(x: Array, y: Array, frame: Frame, previous: Frame) -> tuple[Array, Array]:
    """As ``reprojected``, but from planar depth by way of the world, so that the sky can be a direction."""
    assert frame.camera.view_to_clip[3, 2] == -1.0, "perspective cameras only"
    projection, view = frame.camera.view_to_clip, frame.camera.world_to_view
    sky = ~np.isfinite(frame.depth)
    depth = np.where(sky, 1.0, frame.depth).astype(np.float64)
    ndc_x, ndc_y = 2 * x / frame.width - 1, 1 - 2 * y / frame.height
    w = -depth * projection[3, 2] + projection[3, 3]
    seen = np.stack([ndc_x * w, ndc_y * w], axis=-1) + depth[..., None] * projection[:2, 2] - projection[:2, 3]
    across = seen @ np.linalg.inv(projection[:2, :2]).T
    in_view = np.concatenate([across, -depth[..., None], np.where(sky, 0.0, 1.0)[..., None]], axis=-1)
    to_clip = previous.camera.view_to_clip @ previous.camera.world_to_view @ np.linalg.inv(view)
    clip = in_view @ to_clip.T
    ndc_before = clip[..., :2] / clip[..., 3:]
    return (ndc_before[..., 0] + 1) * frame.width / 2, (1 - ndc_before[..., 1]) * frame.height / 2
