"""What changes from frame to frame in the pixels of a sequence: depth, colour, and what comes into view.

The sample of a pixel wanders with the jitter, so that even what stands still is not the same in two frames, unless they
have one jitter. Each watcher remembers in ``frame`` the first frame in which it was sure.
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

# Depth of one place of a surface, drawn twice with one jitter, differs by rounding at most.
DEPTH_SLACK = 1e-4
# With another jitter the sample is at most a pixel away. Share of pixels outside the range of depth around them, worst
# seen: 0.05 in still scenes (leaves, at 96x54), 0.3 and more under a camera that turns or travels.
MOVED_SHARE = 0.15
# An illumination change that no eight bits show: half a step of a value near 1.
COLOUR_SLACK = 1.0 / 512.0
BLOCK = 8  # pixels: of colour the mean of each block is remembered, for every jitter there is
# With another jitter: share of pixels outside the range of colour around them, worst seen 0.18 in still scenes at
# 160x90, 0.12 at 320x180; 0.32 and more where a lamp flashes, a shadow moves or highlights glint.
CHANGED_SHARE = 0.25
# Share of pixels that come into view, two pixels away from whatever could hide them, since two samples of a pixel and
# a rounded position lie up to 1.5 apart. Worst seen where nothing does: 2e-4, in hair against the sky (160x90).
DISOCCLUDED_SHARE = 5e-4
# A camera's step may disocclude less than a pixel: frames are looked at 1, 2, 4 ... after one, then from the last anew.
FARTHEST = 16


class DepthChange:
    """Depth that changes although nothing moves."""

    def __init__(self) -> None:
        self.frame: int | None = None
        self._first: tuple[tuple[float, float], Plane] | None = None
        self._last: Plane | None = None

    def look(self, header: Frame, depth: Plane) -> None:
        """Take in the depth [H, W] of one frame."""
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
        return float(_outside(depth, self._last, DEPTH_SLACK).mean()) > MOVED_SHARE


class ColourChange:
    """Colour that changes although neither light nor anything else does."""

    def __init__(self) -> None:
        self.frame: int | None = None
        self._means: dict[tuple[float, float], Plane] = {}
        self._last: Plane | None = None

    def look(self, header: Frame, colour: Plane) -> None:
        """Take in the colour [3, H, W] of one frame; a cut begins anew. What is no light counts as none."""
        colour = np.maximum(np.nan_to_num(colour, posinf=0.0, neginf=0.0), 0.0)
        if header.cut or (self._last is not None and colour.shape != self._last.shape):
            self._means, self._last = {}, None
        means = _block_means(colour)
        known = self._means.setdefault(header.jitter_px, means)
        changed = bool((np.abs(means - known) > COLOUR_SLACK * np.maximum(means, known)).any())
        if known is means and self._last is not None:
            outside = [_outside(*planes, COLOUR_SLACK) for planes in zip(colour, self._last, strict=True)]
            changed = float(np.logical_or.reduce(outside).mean()) > CHANGED_SHARE
        if changed and self.frame is None:
            self.frame = header.index
        self._last = colour


class Uncovering:
    """Surfaces that come into view from behind others: by depth and cameras, or by the motion channel."""

    def __init__(self) -> None:
        self.frame: int | None = None
        self._before: Frame | None = None

    def look(self, header: Frame, channels: Mapping[str, Pixels]) -> None:
        """Take in one frame."""
        frame, before = _geometry(header, channels), self._before
        if before is None or frame.cut or frame.depth.shape != before.depth.shape:
            self._before = frame
            return
        # Own motion leads to the frame before and no farther.
        distance = frame.index - before.index
        if self.frame is None and (frame.motion is not None or distance & (distance - 1) == 0):
            found = correspondence(frame, before)
            if float((found.disoccluded & ~_grown(found.edge)).mean()) > DISOCCLUDED_SHARE:
                self.frame = header.index
        if frame.motion is not None or distance >= FARTHEST:
            self._before = frame


def _geometry(header: Frame, channels: Mapping[str, Pixels]) -> Frame:
    """The frame without its colour."""
    planes = [np.asarray(channels[name], np.float32) for name in ("backward.u", "backward.v") if name in channels]
    depth = np.asarray(channels["Z"], np.float32)
    return replace(header, depth=depth, motion=np.stack(planes, axis=-1) if len(planes) == 2 else None)


def _block_means(colour: Plane) -> Plane:
    """Mean of each block of BLOCK x BLOCK pixels, [3, rows, columns]; what is left over at the edges is repeated."""
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
    """Where values that are not negative lie outside the range that the 3x3 around the pixel had before."""
    around = _around(before)
    low, high = np.minimum.reduce(around), np.maximum.reduce(around)
    return np.asarray((plane < low * (1.0 - slack)) | (plane > high * (1.0 + slack)))


def _grown(mask: Mask) -> Mask:
    """The mask and the pixels beside it."""
    return np.asarray(np.logical_or.reduce(_around(mask)))


def _around(plane: Plane) -> list[Plane]:
    """The plane moved to each of the 3x3 places around a pixel; edges repeat."""
    padded = np.pad(plane, 1, mode="edge")
    rows, columns = plane.shape
    return [padded[y : y + rows, x : x + columns] for y in range(3) for x in range(3)]
