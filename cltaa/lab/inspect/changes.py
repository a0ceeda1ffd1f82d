"""Detect changes from frame to frame in the pixels of a sequence: depth, colour and disocclusion.

The sample of a pixel moves with the jitter, so that even a still scene differs between two frames unless they have the
same jitter. Each detector stores in ``frame`` the first frame in which it was certain.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.frame import Frame
from cltaa.io.exr_frame import Pixels
from cltaa.lab.judge.correspondence import correspondence

Plane = NDArray[Any]  # [H, W] or [3, H, W]
Mask = NDArray[np.bool_]

# The depth of one surface point, drawn twice with the same jitter, differs by rounding at most.
DEPTH_SLACK = 1e-4
# With another jitter the sample is at most a pixel away. Share of pixels outside the depth range around them, worst
# seen: 0.05 in still scenes (leaves, at 96x54), 0.3 and more with a rotating or moving camera.
MOVED_SHARE = 0.15
# An illumination change below half an 8-bit step of a value near 1 is invisible.
COLOUR_SLACK = 1.0 / 512.0
BLOCK = 8  # pixels: side of the blocks whose mean colour is stored for each jitter
# With another jitter: share of pixels outside the colour range around them, worst seen 0.18 in still scenes at
# 160x90, 0.12 at 320x180; 0.32 and more with a flashing lamp, a moving shadow or glinting highlights.
CHANGED_SHARE = 0.25
# Share of disoccluded pixels, two pixels away from any occluder, because two samples of a pixel and a rounded position
# are up to 1.5 apart. Worst seen without disocclusion: 2e-4, in hair against the sky (160x90).
DISOCCLUDED_SHARE = 5e-4
# Pixels of a frame; samples of smaller ones lie so far apart that still scenes exceed these shares: at 64x36 0.27 of
# the colours, and 9e-4 disoccluded; at 96x54 no share does.
SMALLEST = 5000
# One camera step may disocclude less than a pixel: compare frames 1, 2, 4 ... after one, then restart from the last.
FARTHEST = 16


class DepthChange:
    """Detects depth that changes although nothing moves."""

    def __init__(self) -> None:
        self.frame: int | None = None
        self._first: tuple[tuple[float, float], Plane] | None = None
        self._last: Plane | None = None

    def look(self, header: Frame, depth: Plane) -> None:
        """Examine the depth [H, W] of one frame."""
        if self.frame is None and self._has_changed(header.jitter_px, depth):
            self.frame = header.index
        if self._first is None:
            self._first = header.jitter_px, depth
        self._last = depth

    def _has_changed(self, jitter_px: tuple[float, float], depth: Plane) -> bool:
        if self._first is None or self._last is None or depth.shape != self._last.shape:
            return False
        if jitter_px == self._first[0]:
            return not _close(depth, self._first[1]).all()
        return depth.size >= SMALLEST and float(_outside(depth, self._last, DEPTH_SLACK).mean()) > MOVED_SHARE


class ColourChange:
    """Detects colour that changes although no change is declared."""

    def __init__(self) -> None:
        self.frame: int | None = None
        self._means: dict[tuple[float, float], Plane] = {}
        self._last: Plane | None = None

    def look(self, header: Frame, colour: Plane) -> None:
        """Examine the colour [3, H, W] of one frame; restarts at a cut. NaN, infinite and negative values become 0."""
        colour = np.maximum(np.nan_to_num(colour, posinf=0.0, neginf=0.0), 0.0)
        if header.cut or (self._last is not None and colour.shape != self._last.shape):
            self._means, self._last = {}, None
        means = _block_means(colour)
        known = self._means.setdefault(header.jitter_px, means)
        changed = bool((np.abs(means - known) > COLOUR_SLACK * np.maximum(means, known)).any())
        if known is means and self._last is not None and colour[0].size >= SMALLEST:
            outside = [_outside(*planes, COLOUR_SLACK) for planes in zip(colour, self._last, strict=True)]
            changed = float(np.logical_or.reduce(outside).mean()) > CHANGED_SHARE
        if changed and self.frame is None:
            self.frame = header.index
        self._last = colour


class Uncovering:
    """Detects disoccluded surfaces, by depth and cameras or by the motion channel."""

    def __init__(self) -> None:
        self.frame: int | None = None
        self._before: Frame | None = None

    def look(self, header: Frame, channels: Mapping[str, Pixels]) -> None:
        """Examine one frame."""
        frame, before = _geometry(header, channels), self._before
        if before is None or frame.cut or frame.depth.shape != before.depth.shape or frame.depth.size < SMALLEST:
            self._before = frame
            return
        # Own motion leads only to the previous frame.
        distance = frame.index - before.index
        if self.frame is None and (frame.motion is not None or distance & (distance - 1) == 0):
            found = correspondence(frame, before)
            if float((found.disoccluded & ~_grown(found.edge)).mean()) > DISOCCLUDED_SHARE:
                self.frame = header.index
        if frame.motion is not None or distance >= FARTHEST:
            self._before = frame


def _geometry(header: Frame, channels: Mapping[str, Pixels]) -> Frame:
    """Return the frame without its colour."""
    planes = [np.asarray(channels[name], np.float32) for name in ("backward.u", "backward.v") if name in channels]
    depth = np.asarray(channels["Z"], np.float32)
    return replace(header, depth=depth, motion=np.stack(planes, axis=-1) if len(planes) == 2 else None)


def _block_means(colour: Plane) -> Plane:
    """Return the mean of each block of BLOCK x BLOCK pixels, [3, rows, columns]; pads with repeated edges."""
    planes, height, width = colour.shape
    padded = np.pad(colour, ((0, 0), (0, -height % BLOCK), (0, -width % BLOCK)), mode="edge")
    blocks = padded.reshape(planes, padded.shape[1] // BLOCK, BLOCK, -1, BLOCK)
    means: Plane = blocks.mean((2, 4), dtype=np.float64)
    return means


def _close(one: Plane, other: Plane) -> Mask:
    with np.errstate(invalid="ignore"):
        near = np.abs(one - other) <= DEPTH_SLACK * np.minimum(one, other)
    return np.asarray((one == other) | near)


def _outside(plane: Plane, before: Plane, slack: float) -> Mask:
    """Return True where a non-negative value lies outside the previous range of its 3x3 neighbourhood."""
    around = _around(before)
    low, high = np.minimum.reduce(around), np.maximum.reduce(around)
    return np.asarray((plane < low * (1.0 - slack)) | (plane > high * (1.0 + slack)))


def _grown(mask: Mask) -> Mask:
    """Return the mask with the pixels beside it."""
    return np.asarray(np.logical_or.reduce(_around(mask)))


def _around(plane: Plane) -> list[Plane]:
    """Return the plane shifted to each of the 3x3 positions around a pixel; edges repeat."""
    padded = np.pad(plane, 1, mode="edge")
    rows, columns = plane.shape
    return [padded[y : y + rows, x : x + columns] for y in range(3) for x in range(3)]
