"""Where each pixel's surface was in the frame before, and what has come into view since, from a capture alone.

Independent of any resolve, in float64 NumPy: the scores of ``cltaa.lab.judge.video_scores`` stand on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cltaa.camera import Displacement, displacement, inverse_depth, reprojected
from cltaa.frame import Frame

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DEPTH_SLACK = 0.05  # of the inverse depth: as far as two samples of one surface may differ, its slope apart
SOLID = 4  # of 9 texels, as at the corner of a thing: a wire covers 3, and its samples come and go by chance
SLOPE_SLACK = 1.5  # pixels: two jittered samples and a rounded position lie so far apart


@dataclass(frozen=True, slots=True)
class Correspondence:
    """For every pixel of a frame, arrays [H, W]: where its surface was one frame ago, and whether it was seen there."""

    x: Array  # pixels, texel centres at +0.5
    y: Array
    same: Mask  # the frame before shows the same surface there
    disoccluded: Mask  # the frame before shows something nearer there, and not just a wire
    edge: Mask  # something nearer stands beside it now, and may cover a part of the pixel
    column: NDArray[np.int64]  # of the nearest texel, limited to the image
    row: NDArray[np.int64]

    @property
    def motion(self) -> Array:
        """Displacement to the previous position in pixels, [H, W, 2]."""
        y, x = np.mgrid[: self.x.shape[0], : self.x.shape[1]] + 0.5
        return np.stack([self.x - x, self.y - y], axis=-1)


def correspondence(frame: Frame, previous: Frame) -> Correspondence:
    """Follow every pixel of ``frame`` into ``previous`` by its motion channel, else by depth and cameras."""
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
    beside = _beside(before)[row, column]  # [H, W, 3, 3] of the frame before
    nearer = beside - expected[..., None, None] > DEPTH_SLACK * np.abs(beside) + slope[..., None, None]
    disoccluded = inside & (seen - expected > slack) & (nearer.sum((2, 3)) >= SOLID)
    nearest = _beside(now).max((2, 3))
    edge = nearest - now > DEPTH_SLACK * np.abs(nearest) + slope
    return Correspondence(x, y, same, disoccluded, edge, column, row)


def _inverse_depth(frame: Frame) -> Array:
    result = np.empty(frame.depth.shape, np.float32)
    inverse_depth(frame.depth, frame.camera, result)
    return result.astype(np.float64)


def _reproject(frame: Frame, now: Array, moved: Displacement) -> tuple[Array, Array, Array, Mask]:
    """Motion u, v, the inverse depth to be expected one frame ago, and where the previous camera could see the
    point."""
    height, width = now.shape
    y, x = np.mgrid[:height, :width].astype(np.float64)
    x += 0.5 + frame.jitter_px[0] - width / 2
    y += 0.5 + frame.jitter_px[1] - height / 2
    u, v, expected, visible = reprojected(x, y, now, moved, parallel=frame.camera.orthographic)
    if frame.motion is not None:
        own = np.isfinite(frame.motion).all(-1)
        u, v = (np.where(own, frame.motion[..., axis], by_camera) for axis, by_camera in enumerate((u, v)))
        # How far an object came nearer is not captured.
        expected = np.where(own, now, expected)
        visible = visible | own
    return u, v, expected, visible


def _beside(plane: Array) -> Array:
    """The 3x3 around every pixel, [H, W, 3, 3]; edges repeat."""
    windows: Array = np.lib.stride_tricks.sliding_window_view(np.pad(plane, 1, mode="edge"), (3, 3))
    return windows


def _slope(values: Array) -> Array:
    """Change a pixel of the surface itself: along each axis the smaller step, so that an edge beside it is no slope."""
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
