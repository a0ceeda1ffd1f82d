"""The frames that a check looks at, and pairs of neighbours with everything that was declared about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cltaa.cameras import Displacement, displacement, is_still, sky_closeness
from cltaa.checking.alignment import Picture
from cltaa.checking.signal import Vector, grid_points, register_signal
from cltaa.frames import Camera, Frame

COVERED = 0.5  # share of the points
AS_FAST = 1e-3  # of the fastest: what moves less rests, but for the rounding of halves


@dataclass(slots=True)
class Pair:
    """Two neighbouring frames at the points looked at: ``x``, ``y`` pixels, ``now`` the signal there."""

    frame: Frame
    previous: Frame
    x: Vector
    y: Vector
    now: Vector
    before: Picture
    scale: float
    closeness: Vector  # as declared; the sky's where there is no depth
    own: Vector  # [2, n], NaN where no vector was given
    usable: NDArray[np.bool_]  # neither reactive nor NaN

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Where a vector says more than depth and matrices: all that have one, or before a camera that stands and in a
        picture full of vectors those that do not rest as most do.
        """
        given: NDArray[np.bool_] = np.asarray(np.isfinite(self.own).all(0))
        if given.mean() < COVERED or not is_still(self.frame.camera, self.previous.camera):
            return given
        beyond = np.hypot(*(self.own - np.median(self.own[:, given], axis=1)[:, None]))
        apart: NDArray[np.bool_] = np.asarray(given & (beyond > AS_FAST * np.max(beyond[given])))
        return apart if apart.mean() < COVERED else given

    @property
    def jitter_change(self) -> Vector:
        """Declared jitter of this frame minus that of the previous one, [2]."""
        change: Vector = np.array(self.frame.jitter_px) - np.array(self.previous.jitter_px)
        return change

    def camera_motion(
        self, camera: Camera | None = None, previous: Camera | None = None, closeness: Vector | None = None
    ) -> Vector:
        """Motion [2, n] in pixels that the cameras and the closeness give; NaN where the point was not in front."""
        camera, previous = camera or self.frame.camera, previous or self.previous.camera
        if is_still(camera, previous):
            return np.zeros((2, len(self.x)))
        moved = displacement(camera, previous, self.frame.width, self.frame.height)
        px = self.x + 0.5 + self.frame.jitter_px[0] - self.frame.width / 2
        py = self.y + 0.5 + self.frame.jitter_px[1] - self.frame.height / 2
        return apply_displacement(moved, px, py, self.closeness if closeness is None else closeness)

    def declared_motion(self) -> Vector:
        """Motion [2, n]: the channel where it holds a vector, else what cameras and depth give."""
        return np.where(np.isfinite(self.own), self.own, self.camera_motion())


def apply_displacement(moved: Displacement, px: Vector, py: Vector, closeness: Vector) -> Vector:
    """Motion [2, n] of points at (px, py) from the image's centre (docs/conventions.md, Matrices)."""
    by = np.stack([px, py, closeness, np.ones_like(px)])
    dx, dy, dw = moved.rows @ by
    w = 1.0 + dw
    with np.errstate(divide="ignore", invalid="ignore"):
        motion = np.stack([dx - px * dw, dy - py * dw]) / w
    return np.where(w > 0, motion, np.nan)


@dataclass(slots=True)
class Shot:
    """Frames in order, and which of their numbers were declared and not filled in by the reader.

    ``window`` is the width and height of the display window, of which a frame may show a region.
    """

    frames: Sequence[Frame]
    window: tuple[int, int]
    has_camera: bool = True
    has_depth: bool = True
    has_jitter: bool = True
    pairs: list[Pair] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Prepare the pairs; a cut or a gap parts two frames."""
        signals = [Picture.of(register_signal(frame.colour)) for frame in self.frames]
        for place in range(1, len(self.frames)):
            frame, previous = self.frames[place], self.frames[place - 1]
            if frame.cut or frame.index != previous.index + frame.step:
                continue
            self.pairs.append(_pair(frame, previous, signals[place], signals[place - 1]))


def planar_closeness(depth: NDArray[np.float32] | Vector, camera: Camera) -> Vector:
    """Planar depth as closeness in float64 (``cltaa.cameras.closeness`` without its float32)."""
    wide = depth.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        near = -wide if camera.orthographic else np.where(wide > 0, 1.0 / wide, 0.0)
    return np.where(np.isfinite(near), near, sky_closeness(camera))


def _pair(frame: Frame, previous: Frame, now: Picture, before: Picture) -> Pair:
    x, y = grid_points(frame.height, frame.width)
    own = np.full((2, len(x)), np.nan)
    if frame.motion is not None:
        own = frame.motion[y, x].T.astype(np.float64)
    usable: NDArray[np.bool_] = np.asarray(np.isfinite(frame.colour[y, x]).all(-1))
    if frame.reactive is not None:
        usable &= ~(frame.reactive[y, x] > 0.1)
    signal = now.signal[y, x].astype(np.float64)
    return Pair(
        frame=frame, previous=previous, x=x.astype(np.float64), y=y.astype(np.float64), now=signal, before=before,
        scale=max(2.0 * float(np.std(signal)), 1e-6), closeness=planar_closeness(frame.depth[y, x], frame.camera),
        own=own, usable=usable,
    )  # fmt: skip
