"""Register pairs of frames: band-pass them and fit the shift between them by least squares.

The method is that of Lucas and Kanade (1981, An iterative image registration technique), over all points at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.camera import displacement, is_still, reprojected, sky_inverse_depth
from cltaa.frame import Camera, Frame, Image
from cltaa.inputs.bilinear import sampled
from cltaa.io.display import LUMA

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]
Points = tuple[NDArray[np.int64], NDArray[np.int64]]  # columns and rows

FINE_PX = 0.6  # standard deviation of the blur that reduces the aliasing of one sample a pixel
COARSE_PX = 4.0  # and of the subtracted blur: slower changes are light, not position
MOST_POINTS = 60_000  # points used in a frame; more only cost time


def register_signal(colour: Image) -> NDArray[np.float32]:
    """Return the frequency band of ``colour`` [H, W, 3] that carries position: [H, W] float32, local mean zero."""
    squeezed = squeezed_light(colour)
    return np.subtract(blur(squeezed, FINE_PX), blur(squeezed, COARSE_PX), dtype=np.float32)


def squeezed_light(colour: Image) -> NDArray[np.float32]:
    """Return the luminance of ``colour`` [H, W, 3] tonemapped to 0 to 1, [H, W] float32."""
    finite = np.nan_to_num(colour.astype(np.float32), nan=0.0, posinf=65504.0, neginf=0.0)
    light: NDArray[np.float32] = np.maximum(finite @ LUMA, np.float32(0))
    # Tonemapped by its own median: highlights do not dominate, and exposure cancels.
    middle = float(np.median(light[light > 0])) if (light > 0).any() else 1.0
    squeezed: NDArray[np.float32] = light / (light + np.float32(middle))
    return squeezed


def blur(image: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """Blur [H, W] by a Gaussian, with repeated edges."""
    radius = max(1, round(3 * sigma))
    offsets = np.arange(-radius, radius + 1)
    weights = np.exp(-0.5 * (offsets / sigma) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    for axis in (0, 1):
        taps = zip(weights, _shifted(image, radius, axis), strict=True)
        image = sum((weight * there for weight, there in taps), np.zeros_like(image))
    return image


def _shifted(image: NDArray[np.float32], reach: int, axis: int) -> Iterator[NDArray[np.float32]]:
    """Yield [H, W] moved along an axis by -``reach`` to ``reach`` texels; edges repeat."""
    padded = np.pad(image, [(reach, reach) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
    for first in range(2 * reach + 1):
        there = slice(first, first + image.shape[axis])
        yield padded[there] if axis == 0 else padded[:, there]


def grid_points(height: int, width: int) -> Points:
    """Return columns and rows of at most MOST_POINTS pixels in a regular grid."""
    step = int(np.ceil(np.sqrt(max(1.0, height * width / MOST_POINTS))))
    y, x = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    return x.ravel(), y.ravel()


ITERATIONS, LEAST_STEP_PX = 8, 4e-3
FARTHEST_PX = 2.0  # a larger shift is no jitter
LEAST_POINTS = 60  # fewer decide nothing


# A signal and its gradient in x and in y, [3, H, W], sampled together at the same positions.
Picture = NDArray[np.float32]


def with_gradient(signal: NDArray[np.float32]) -> Picture:
    """Stack ``signal`` [H, W] and its central differences, which are 0 along an axis of one pixel."""
    slopes = [np.gradient(signal, axis=axis) if signal.shape[axis] > 1 else np.zeros_like(signal) for axis in (1, 0)]
    return np.stack([signal, *slopes])


class Fit(NamedTuple):
    """The shift [2] of the earlier picture, its information matrix [2, 2] (inverse covariance), and the residual.

    ``halves`` [2, 2] are the shifts of two halves of the points; ``judge`` returns the second half's residual under any
    shift.
    """

    shift: Vector
    information: Vector
    residual: float  # 0: the pictures agree; 1: as different as unrelated ones
    halves: Vector = np.zeros((2, 2))
    judge: Callable[[float, float], float] = lambda _x, _y: 0.0


Shifts = tuple[list[Fit | None], bool]  # of each pair, and whether they were measured without motion vectors


def fit_shift(now: Vector, before: Picture, x: Vector, y: Vector, scale: float) -> Fit:
    """Fit ``now`` = ``before`` at (x, y) + shift, positions in texels; ``scale`` is the difference with residual 1."""
    shift, information = find_shift(now, before, x, y, scale)
    found = residual_of(now, before, x + shift[0], y + shift[1], scale)
    noise = max(found, 1e-3) * scale
    return Fit(shift, information / noise**2, found)


def find_shift(now: Vector, before: Picture, x: Vector, y: Vector, scale: float) -> tuple[Vector, Vector]:
    """Return the shift [2] of ``fit_shift`` and the sum of the weighted products of gradients [2, 2] there."""
    shift = np.zeros(2)
    information = np.zeros((2, 2))
    for _ in range(ITERATIONS):
        left, slope, weight, _ = linearised(now, before, x + shift[0], y + shift[1], scale)
        information = (slope * weight) @ slope.T
        trace, determinant = float(np.trace(information)), float(np.linalg.det(information))
        if len(left) < LEAST_POINTS or trace**2 >= 1e6 * determinant:  # their ratio is about the condition number
            break
        step = np.linalg.solve(information, (slope * weight) @ left)
        shift += np.clip(step, -0.5, 0.5)
        if np.abs(shift).max() > FARTHEST_PX:
            shift = np.clip(shift, -FARTHEST_PX, FARTHEST_PX)
            break
        if np.abs(step).max() < LEAST_STEP_PX:
            break
    return shift, information


def residual_of(now: Vector, before: Picture, x: Vector, y: Vector, scale: float) -> float:
    """Return the mean of the ``differences`` of the points."""
    return float(differences(now, before, x, y, scale).mean()) if len(now) else 1.0


def differences(now: Vector, before: Picture, x: Vector, y: Vector, scale: float) -> Vector:
    """Return min(|difference| / scale, 1) for each point; 1 for points outside the earlier picture."""
    there, inside = sampled(before[0], x, y)
    return np.where(inside, np.minimum(np.abs(now - there) / scale, 1.0), 1.0)


def linearised(now: Vector, before: Picture, x: Vector, y: Vector, scale: float) -> tuple[Vector, Vector, Vector, Mask]:
    """Return residuals, gradients [2, n] and robust weights (Geman-McClure) of the points inside the earlier picture,
    and their mask."""
    there, inside = sampled(before, x, y)
    left, *slopes = (values[inside] for values in (now - there[0], *there[1:]))
    slope = np.array(slopes)
    weight = 1.0 / (1.0 + (left / scale) ** 2) ** 2
    return left, slope, weight, inside


COVERED = 0.5  # share of the points from which vectors fill the picture
OPAQUE = 0.99  # alpha; a translucent surface also shows the motion behind it
UNCOVERED_PX, IN_FRONT = 2, 0.9  # distance from a depth edge in pixels; depth of the occluder over that behind it
MOST_UNCOVERED = 0.5  # least share of points to keep; with fewer, edges are everywhere and must be used
BLOCK = 8  # pixels; in a chequer of such blocks, one colour is for fitting and the other for judging
LEAST_SIDE = 2 * BLOCK + 1  # least side of a matched picture; up to 16 pixels right captures gave mistakes
AS_FAST = 1e-3  # share of the fastest motion below which a point rests, because of the rounding of halves


@dataclass(slots=True)
class Pair:
    """Two neighbouring frames at chosen points: ``x``, ``y`` in pixels, ``now`` the signal there."""

    frame: Frame
    previous: Frame
    x: Vector
    y: Vector
    now: Vector
    before: Picture
    scale: float
    inverse_depth: Vector  # as declared; the sky's without depth
    own: Vector  # declared vectors [2, n], NaN for none
    lit: Mask  # True where neither reactive nor NaN
    usable: Mask  # True where lit, opaque, and not just behind a nearer surface (unless edges are everywhere)

    @property
    def moving(self) -> NDArray[np.bool_]:
        """True where a vector differs from camera motion: at all vectors, but if they fill the picture of a still
        camera, only at those that do not rest as most do."""
        given: NDArray[np.bool_] = np.asarray(np.isfinite(self.own).all(0))
        if given.mean() < COVERED or not is_still(self.frame.camera, self.previous.camera):
            return given
        beyond = np.hypot(*(self.own - np.median(self.own[:, given], axis=1)[:, None]))
        apart: NDArray[np.bool_] = np.asarray(given & (beyond > AS_FAST * np.max(beyond[given])))
        return apart if apart.mean() < COVERED else given

    @property
    def held_back(self) -> Mask:
        """Points for judging fits, in blocks, so that they share neither noise nor edges with the fitted points."""
        return np.asarray((self.x // BLOCK + self.y // BLOCK) % 2 == 1)

    @property
    def jitter_change(self) -> Vector:
        """Declared jitter of this frame minus that of the previous one, [2]."""
        change: Vector = np.array(self.frame.jitter_px) - np.array(self.previous.jitter_px)
        return change

    def camera_motion(
        self, camera: Camera | None = None, previous: Camera | None = None, inverse_depth: Vector | None = None
    ) -> Vector:
        """Return the motion [2, n] in pixels by cameras and inverse depth; NaN for points behind the camera, and where
        matrices have no inverse, which a finding tells."""
        camera, previous = camera or self.frame.camera, previous or self.previous.camera
        if is_still(camera, previous):
            return np.zeros((2, len(self.x)))
        try:
            moved = displacement(camera, previous, self.frame.width, self.frame.height)
        except ZeroDivisionError:
            return np.full((2, len(self.x)), np.nan)
        px = self.x + 0.5 + self.frame.jitter_px[0] - self.frame.width / 2
        py = self.y + 0.5 + self.frame.jitter_px[1] - self.frame.height / 2
        inverse_depth = self.inverse_depth if inverse_depth is None else inverse_depth
        u, v, _, visible = reprojected(px, py, inverse_depth, moved, parallel=False)
        return np.where(visible, np.stack([u, v]), np.nan)

    def motion_under(self, change: Callable[[Camera], Camera], scale: float = 1.0) -> Vector:
        """Return ``camera_motion`` after ``change`` of both cameras, and with depth times ``scale``."""
        return self.camera_motion(change(self.frame.camera), change(self.previous.camera), self.inverse_depth / scale)

    def declared_motion(self) -> Vector:
        """Return the motion [2, n]: the declared vector if there is one, else the camera's motion."""
        return np.where(np.isfinite(self.own), self.own, self.camera_motion())

    def at(self, points: NDArray[np.int64]) -> Pair:
        """Return the pair at some of its points, by their indices."""
        return replace(self, **{name: getattr(self, name)[..., points] for name in OF_POINTS})


OF_POINTS = ("x", "y", "now", "inverse_depth", "own", "lit", "usable")  # the arrays of a Pair whose last axis is points


HELD = {"jittered": 1, "not-jittered": 0, "jittered-reversed": -1}  # of the change of jitter, in stored vectors


@dataclass(slots=True)
class Shot:
    """Frames in order; ``has_*`` is True for data that were declared and not filled in by the reader.

    ``window`` is the width and height of the display window; frames may show a region of it. ``unit`` is that of the
    stored vectors, in pixels; ``jittered`` the factor of the change of jitter that their reader took out of them.
    """

    frames: Sequence[Frame]
    window: tuple[int, int]
    has_camera: bool = True
    has_depth: bool = True
    has_jitter: bool = True
    unit: tuple[float, float] = (1.0, 1.0)
    jittered: int = 0
    pairs: list[Pair] = field(default_factory=list)
    shifts: Shifts | None = None  # cached by ``measure_shifts``

    @property
    def leaks(self) -> dict[str, int]:
        """Factors of the change of jitter that the vectors may contain as read, by what is then true of the files."""
        return {name: held - self.jittered for name, held in HELD.items() if held != self.jittered}

    @property
    def narrow(self) -> bool:
        """True for pictures with too few columns or rows to register."""
        return min(self.frames[0].width, self.frames[0].height) < LEAST_SIDE

    def __post_init__(self) -> None:
        """Prepare the pairs; leaves out those with a cut or a gap between them."""
        signals = [with_gradient(register_signal(frame.colour)) for frame in self.frames]
        for place in range(1, len(self.frames)):
            frame, previous = self.frames[place], self.frames[place - 1]
            if frame.cut or frame.index != previous.index + frame.step:
                continue
            self.pairs.append(_pair(frame, previous, signals[place], signals[place - 1]))


def planar_inverse_depth(depth: NDArray[np.float32] | Vector, camera: Camera) -> Vector:
    """Convert planar depth to inverse depth in float64 (``cltaa.camera.inverse_depth`` uses float32)."""
    wide = depth.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        near = -wide if camera.orthographic else np.where(wide > 0, 1.0 / wide, 0.0)
    return np.where(np.isfinite(near), near, sky_inverse_depth(camera))


def _pair(frame: Frame, previous: Frame, now: Picture, before: Picture) -> Pair:
    x, y = grid_points(frame.height, frame.width)
    own = np.full((2, len(x)), np.nan)
    if frame.motion is not None:
        own = frame.motion[y, x].T.astype(np.float64)
    lit: Mask = np.asarray(np.isfinite(frame.colour[y, x]).all(-1))
    if frame.reactive is not None:
        lit &= ~(frame.reactive[y, x] > 0.1)
    usable = lit if frame.alpha is None else lit & (frame.alpha[y, x] >= OPAQUE)
    seen = usable & ~_uncovered(frame.depth)[y, x]
    usable = seen if seen.sum() >= MOST_UNCOVERED * usable.sum() else usable
    signal = now[0, y, x].astype(np.float64)
    return Pair(
        frame=frame,
        previous=previous,
        x=x.astype(np.float64),
        y=y.astype(np.float64),
        now=signal,
        before=before,
        scale=max(2.0 * float(np.std(signal)), 1e-6),
        inverse_depth=planar_inverse_depth(frame.depth[y, x], frame.camera),
        own=own,
        lit=lit,
        usable=usable,
    )


def _uncovered(depth: NDArray[np.float32]) -> Mask:
    """Return a mask [H, W] of pixels behind something within UNCOVERED_PX, where a moving occluder may have uncovered
    them."""
    nearest = np.where(np.isfinite(depth), np.abs(depth), np.float32(np.inf))
    for axis in (0, 1):
        nearest = np.minimum.reduce([*_shifted(nearest, UNCOVERED_PX, axis)])
    return np.asarray(np.isfinite(nearest) & ~(np.abs(depth) * IN_FRONT <= nearest))


LEAST_ANCHORS = 4 * LEAST_POINTS  # least resting points of a pair; with fewer, the whole picture is more reliable
LARGEST_RESIDUAL = 0.6  # above it the pictures do not match, and a shift means nothing


def measure_shifts(shot: Shot) -> Shifts:
    """Return the shift of the picture by jitter for each pair, and whether it was measured without motion vectors."""
    if shot.shifts is None:
        anchors = [pair.usable & ~pair.moving for pair in shot.pairs]
        anchored = shot.has_camera and bool(anchors) and all(anchor.sum() >= LEAST_ANCHORS for anchor in anchors)
        masks = anchors if anchored else [pair.usable for pair in shot.pairs]
        shot.shifts = [_shift(pair, mask, anchored) for pair, mask in zip(shot.pairs, masks, strict=True)], anchored
    return shot.shifts


def stays_inside(place: Vector, width: int, height: int) -> Mask:
    """Return True for positions [2, n] that no compared shift moves out of the picture, where residuals are 1."""
    last = np.array([width - 1, height - 1])[:, None]
    return np.asarray(((place >= FARTHEST_PX) & (place < last - FARTHEST_PX)).all(0))


def _inside(pair: Pair, motion: Vector) -> Mask:
    return stays_inside(np.stack([pair.x, pair.y]) + motion, pair.frame.width, pair.frame.height)


def seen_before(pair: Pair, motion: Vector, points: Mask) -> Mask:
    """Return those of ``points`` that stay in the picture under ``motion``; all of them if few stay.

    A column that leaves a small picture has residual 1 and would outweigh the rest, in favour of smaller motion.
    """
    seen = points & _inside(pair, motion)
    return seen if seen.sum() >= COVERED * points.sum() else points


def _shift(pair: Pair, there: Mask, anchored: bool) -> Fit | None:
    motion = pair.camera_motion() if anchored else pair.declared_motion()
    there = there & np.isfinite(motion).all(0)
    if there.sum() < LEAST_POINTS:
        return None
    x, y, now = pair.x + motion[0], pair.y + motion[1], pair.now
    fit = fit_shift(now[there], pair.before, x[there], y[there], pair.scale)
    if fit.residual >= LARGEST_RESIDUAL:
        return None
    back = there & pair.held_back
    parts = (there & ~back, back)
    halves = [find_shift(now[part], pair.before, x[part], y[part], pair.scale)[0] for part in parts]
    judging = back & _inside(pair, motion)

    def judge(right: float, down: float) -> float:
        return residual_of(now[judging], pair.before, x[judging] + right, y[judging] + down, pair.scale)

    return fit._replace(halves=np.array(halves), judge=judge)
