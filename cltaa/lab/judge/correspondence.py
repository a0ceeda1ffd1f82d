"""Reproject each pixel's surface into the previous frame, and find disoccluded pixels, from a capture alone.

Independent of any resolve, in float64 NumPy; ``cltaa.lab.judge.video_scores`` uses it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cltaa.camera import Displacement, displacement, inverse_depth, reprojected
from cltaa.frame import Frame

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DEPTH_SLACK = 0.05  # two samples of one surface may differ by this share of the inverse depth, plus its slope
SOLID = 4  # of 9 texels, as at the corner of an object: a wire covers 3, and its samples come and go by chance
SLOPE_SLACK = 1.5  # pixels: largest distance of two jittered samples and a rounded position


@dataclass(frozen=True, slots=True)
class Correspondence:
    """For every pixel of a frame, arrays [H, W]: its surface's previous position, and whether it was visible there."""

    x: Array  # pixels, texel centres at +0.5
    y: Array
    same: Mask  # True where the previous frame shows the same surface there
    disoccluded: Mask  # True where the previous frame shows an occluder there, wider than a wire
    edge: Mask  # True where something nearer is next to the pixel now, and may cover part of it
    column: NDArray[np.int64]  # of the nearest texel, clamped to the image
    row: NDArray[np.int64]

    @property
    def motion(self) -> Array:
        """Displacement to the previous position in pixels, [H, W, 2]."""
        y, x = np.mgrid[: self.x.shape[0], : self.x.shape[1]] + 0.5
        return np.stack([self.x - x, self.y - y], axis=-1)


def correspondence(frame: Frame, previous: Frame) -> Correspondence:
    """Reproject every pixel of ``frame`` into ``previous`` by its motion channel, else by depth and cameras."""
    height, width = frame.depth.shape
    moved = displacement(frame.camera, previous.camera, width, height)
    now, before = _inverse_depth(frame), _inverse_depth(previous)
    u, v, expected, visible = _reproject(frame, now, moved)
    y, x = np.mgrid[:height, :width] + 0.5
    x, y = x + u, y + v
    inside = visible & (x >= 0) & (y >= 0) & (x < width) & (y < height)
    column = np.where(inside, np.floor(x), 0).astype(np.int64)
    row = np.where(inside, np.floor(y), 0).astype(np.int64)
    seen = before[row, column]
    slope = SLOPE_SLACK * _slope(now)
    slack = DEPTH_SLACK * np.maximum(np.abs(seen), np.abs(expected)) + slope
    same = inside & (np.abs(seen - expected) <= slack)
    beside = _beside(before)[row, column]  # [H, W, 3, 3] of the previous frame
    nearer = beside - expected[..., None, None] > DEPTH_SLACK * np.abs(beside) + slope[..., None, None]
    disoccluded = inside & (seen - expected > slack) & (nearer.sum((2, 3)) >= SOLID)
    nearest = _beside(now).max((2, 3))
    edge = nearest - now > DEPTH_SLACK * np.abs(nearest) + slope
    return Correspondence(x, y, same, disoccluded, edge, column, row)


def _inverse_depth(frame: Frame) -> Array:
    result = np.empty(frame.depth.shape, np.float32)
    inverse_depth(frame.depth, result, parallel=frame.camera.orthographic)
    return result.astype(np.float64)


def _reproject(frame: Frame, now: Array, moved: Displacement) -> tuple[Array, Array, Array, Mask]:
    """Return motion u, v, the expected inverse depth in the previous frame, and where the point was in front of its
    camera."""
    height, width = now.shape
    y, x = np.mgrid[:height, :width].astype(np.float64)
    x += 0.5 + frame.jitter_px[0] - width / 2
    y += 0.5 + frame.jitter_px[1] - height / 2
    u, v, expected, visible = reprojected(x, y, now, moved, parallel=frame.camera.orthographic)
    if frame.motion is not None:
        own = np.isfinite(frame.motion).all(-1)
        u, v = (np.where(own, frame.motion[..., axis], by_camera) for axis, by_camera in enumerate((u, v)))
        # The change of depth by own motion is unknown.
        expected = np.where(own, now, expected)
        visible = visible | own
    return u, v, expected, visible


def _beside(plane: Array) -> Array:
    """Return the 3x3 neighbourhood of every pixel, [H, W, 3, 3]; edges repeat."""
    windows: Array = np.lib.stride_tricks.sliding_window_view(np.pad(plane, 1, mode="edge"), (3, 3))
    return windows


def _slope(values: Array) -> Array:
    """Return the surface's change per pixel: the smaller step along each axis, so that an edge is no slope."""
    total = np.zeros_like(values)
    for axis in (0, 1):
        step = np.abs(np.diff(values, axis=axis))
        edge = [(0, 0), (0, 0)]
        edge[axis] = (1, 1)
        padded = np.pad(step, edge, constant_values=np.inf)
        length = values.shape[axis]
        smaller = np.minimum(np.take(padded, range(length), axis), np.take(padded, range(1, length + 1), axis))
        total += np.where(np.isfinite(smaller), smaller, 0.0)  # one pixel wide: no slope
    return total
