"""What a sequence declares held against what its pixels show.

A broken promise (an effect that is there and not declared) makes a resolve wrong, because the plan trusts the list; an
idle one (declared, and never there) only costs time.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from cltaa.exr_attributes import FrameHeader
from cltaa.exr_channels import Pixels
from cltaa.frames import Effect

Depth = NDArray[np.float32]

BRIGHT = 8.0  # "far above 1"
# Depth of one place of a surface, drawn twice with one jitter, differs by rounding at most.
DEPTH_SLACK = 1e-4
# With another jitter the sample is at most a pixel away. Share of pixels outside the range of depth around them, worst
# seen: 0.05 in still scenes (leaves, at 96x54), 0.3 and more under a camera that turns or travels.
MOVED_SHARE = 0.15


class Witness:
    """Looks at the frames of a sequence in order; ``broken`` and ``idle`` say what it saw."""

    def __init__(self) -> None:
        self._seen: set[Effect] = set()
        self._brightest = 0.0
        self._first: tuple[tuple[float, float], Depth] | None = None
        self._last: Depth | None = None
        self._moved: int | None = None

    def look(self, header: FrameHeader, channels: Mapping[str, Pixels]) -> None:
        """Take in one frame."""
        self._seen |= set(_shown(channels))
        self._brightest = max(self._brightest, *(_highest(channels[name]) for name in "RGB"))
        depth = np.asarray(channels["Z"], np.float32)
        if self._moved is None and self._has_moved(header.jitter_px, depth):
            self._moved = header.index
        if self._first is None:
            self._first = header.jitter_px, depth
        self._last = depth

    def _has_moved(self, jitter_px: tuple[float, float], depth: Depth) -> bool:
        if self._first is None or self._last is None or depth.shape != self._last.shape:
            return False
        if jitter_px == self._first[0]:
            return not _close(depth, self._first[1]).all()
        return float(_outside(depth, self._last).mean()) > MOVED_SHARE

    def broken(self, declared: frozenset[Effect] | None) -> list[str]:
        """Effects that the pixels show and the declaration leaves out."""
        if declared is None:
            return []
        problems = []
        if self._brightest > BRIGHT and Effect.HDR not in declared:
            problems.append(f"effect hdr shows in the pixels (up to {self._brightest:.4g}) but is not declared")
        moving = {Effect.CAMERA, Effect.MOTION, Effect.UNCOVER, Effect.CUT}
        if self._moved is not None and not declared & moving:
            problems.append(
                f"depth changes at frame {self._moved}, but no effect out of {', '.join(sorted(moving))} is declared"
            )
        return problems

    def idle(self, declared: frozenset[Effect] | None) -> list[str]:
        """Effects that are declared and never show, with what makes that sure."""
        return [
            f"effect {effect} is declared, but {says}: leave it out and save its step"
            for effect, says in _IDLE.items() if effect in (declared or ()) and effect not in self._seen
        ]  # fmt: skip


_IDLE = {
    Effect.MOTION: "the motion channel is zero or NaN everywhere",
    Effect.REACTIVE: "channel reactive is 0 everywhere",
    Effect.ALPHA: "channel A is 1 everywhere",
    Effect.HDR: "no value is above 1",
    Effect.SKY: "depth is finite everywhere",
}


def _shown(channels: Mapping[str, Pixels]) -> Iterable[Effect]:
    """Effects that one frame's pixels show; what lies between 1 and BRIGHT may be called HDR or not."""
    motion = [channels[name] for name in ("backward.u", "backward.v") if name in channels]
    if any((np.nan_to_num(plane) != 0).any() for plane in motion):
        yield Effect.MOTION
    if "reactive" in channels and (channels["reactive"] != 0).any():
        yield Effect.REACTIVE
    if "A" in channels and (channels["A"] != 1).any():
        yield Effect.ALPHA
    if any(_highest(channels[name]) > 1.0 for name in "RGB"):
        yield Effect.HDR
    if np.isinf(channels["Z"]).any():
        yield Effect.SKY


def _highest(plane: Pixels) -> float:
    return float(np.max(np.asarray(plane, np.float32), where=np.isfinite(plane), initial=0.0))


def _close(one: Depth, other: Depth) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        near = np.abs(one - other) <= DEPTH_SLACK * np.minimum(one, other)
    return np.asarray((one == other) | near)


def _outside(depth: Depth, before: Depth) -> NDArray[np.bool_]:
    """Where depth lies outside the range that the 3x3 around the pixel had before."""
    padded = np.pad(before, 1, mode="edge")
    rows, columns = depth.shape
    near = [padded[y : y + rows, x : x + columns] for y in range(3) for x in range(3)]
    low, high = np.minimum.reduce(near), np.maximum.reduce(near)
    return np.asarray((depth < low * (1.0 - DEPTH_SLACK)) | (depth > high * (1.0 + DEPTH_SLACK)))
