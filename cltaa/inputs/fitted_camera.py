"""Fit the camera to the motion vectors and the depth of each frame, where no matrices tell it.

A resting point p = (px, py, 1/Z, 1) was at (p_xy + D_xy p) / (1 + D_w p) (docs/conventions.md, Matrices). That makes
two linear equations a pixel, and random sample consensus (Fischler and Bolles 1981) finds the D that most pixels
follow. Vectors leave a factor of I + D open, by which points come nearer. A camera that turns and travels keeps
volumes, which determines it. Where the depth of the frame before denies that, the camera zooms, and depth
determines it.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import NDArray

from cltaa.core.constants import value
from cltaa.core.frame_checks import check_camera
from cltaa.errors import DataError
from cltaa.frame import NO_CAMERA, Asked, Camera, Effect, Frame, Matrix
from cltaa.inputs.bilinear import sample
from cltaa.inputs.foreign import ForeignSequence
from cltaa.io.exr_frame import MATRICES
from cltaa.io.exr_layout import Layout, of_region
from cltaa.io.sequence import FrameSequence
from cltaa.io.streams import ReadAhead
from cltaa.printable import counted
from cltaa.progress import Advance

Vector = NDArray[np.float64]

MOST_POINTS = 20_000  # points of a frame
# Choices of CHOSEN points, which determine the eleven open numbers of D, in lots of TRIES until one was of points that
# follow the camera alone with a probability of 1 - MISSED. RANKED points rank them. So few points determine D less well
# than all will, hence LOOSE.
TRIES, MOST_TRIES, CHOSEN, RANKED, MISSED = 256, 8192, 6, 512, 1e-3
LOOSE = 16.0, 4.0, 1.0, 1.0  # times the error that a vector may have; then least squares over the points within it
LEAST_POINTS = 60  # ten times as many as determine D
LEAST_FOLLOW = 0.25  # least share of the points that follow the camera
STANDS = 0.5  # the camera stands if so many of these do not move
ZOOMS = 1e-4  # least change of depth that neither turning nor travelling explains; under 1e-5 in nine captures of such
SURE = 4.0  # in standard errors
COLLINEAR = 1e-9  # singular values below this share of the largest are 0, as on a wall, where 1/Z tells nothing new
BITS = 32  # of the matrices: more differ with the number of threads, and a resumed run needs the same

FIRST = Camera(
    NO_CAMERA.world_to_view, NO_CAMERA.view_to_clip
)  # of a shot's first frame: any but NO_CAMERA, which means none
UNMOVED = np.eye(4)[[0, 1, 3]]  # rows x, y, w of what maps (px, py, 1/Z, 1) to the frame before, [3, 4]


class _Points(NamedTuple):
    """Columns and rows from the image centre, inverse depth, and motion to the frame before, each [..., n]."""

    x: Vector
    y: Vector
    near: Vector
    u: Vector
    v: Vector

    def those(self, chosen: Any) -> _Points:
        """Return the points of an index or a mask."""
        return _Points(*(each[chosen] for each in self))

    @property
    def length(self) -> Vector:
        """The larger component of the motion."""
        return np.maximum(np.abs(self.u), np.abs(self.v))

    @property
    def place(self) -> Vector:
        """The points as (px, py, 1/Z, 1), [..., n, 4]."""
        return np.stack([self.x, self.y, self.near, np.ones_like(self.x)], -1)


def lacks_camera(sequence: FrameSequence, effects: Asked) -> TypeGuard[ForeignSequence]:
    """Return True if a camera can be fitted to vectors and depth of ``sequence`` and nothing tells or denies one."""
    return (
        isinstance(sequence, ForeignSequence)
        and bool(sequence.undeclared & MATRICES)
        and sequence.intake.profile.camera.source != "none"
        and sequence.channels >= {"backward.u", "Z"}
        and (isinstance(effects, str) or Effect.CAMERA in effects)
    )


class Fitted(NamedTuple):
    """The camera of each frame, by number; the share of the points that follow it, of frames that it was fitted to; and
    why none fits others, in which it is taken to stand."""

    cameras: dict[int, Camera]
    shares: dict[int, float]
    faults: dict[int, DataError]
    seconds: float

    @property
    def line(self) -> str:
        """The outcome in one line."""
        told = f"{counted(len(self.cameras), 'frame')}, {self.seconds:.1f} s"
        if self.faults:
            number, fault = next(iter(self.faults.items()))
            others = f" and {counted(len(self.faults) - 1, 'other frame')}" if len(self.faults) > 1 else ""
            told += f"; not in frame {number}{others}: {fault.what}"
        if not self.fits:
            return f"no camera is fitted, vectors alone tell what moves ({told})"
        worst = min(self.shares, key=self.shares.__getitem__)
        share = f"{self.shares[worst]:.0%} of the surfaces follow it in frame {worst}, no less in others"
        return f"camera fitted to vectors and depth: {share} ({told})"

    @property
    def fits(self) -> bool:
        """Whether the camera is known in most frames."""
        return len(self.shares) > len(self.faults)


def fit_cameras(sequence: ForeignSequence, advance: Advance | None = None) -> Fitted:
    """Return the camera of each frame, true up to an affine change of the world."""
    started, shares, faults = time.perf_counter(), dict[int, float](), dict[int, DataError]()
    cameras, step = dict.fromkeys(sequence.numbers, FIRST), sequence.step
    later = {number for number in cameras if number - step in cameras and _continues(sequence, number)}
    needed = sorted(later | {number - step for number in later})
    last: Frame | DataError = DataError("no frame")
    with ReadAhead(partial(_surfaces, sequence, number) for number in needed) as frames:
        for done, (number, frame) in enumerate(zip(needed, frames, strict=True), start=1):
            before = number - step
            if number in later:
                cameras[number] = cameras[before]
                try:
                    change, share = fitted_change(_readable(frame), _readable(last))
                    cameras[number] = _moved(
                        cameras[before], change, sequence.layouts[before], sequence.layouts[number]
                    )
                    shares[number] = share
                except DataError as error:
                    faults[number] = error
            if advance is not None:
                advance(done, len(needed))
            last = frame
    return Fitted(cameras, shares, faults, time.perf_counter() - started)


def _surfaces(sequence: ForeignSequence, number: int) -> Frame | DataError:
    """Return depth and motion of a frame, or why they cannot be read, which the resolve will raise."""
    try:
        return sequence.surfaces(number)
    except DataError as error:
        return error


def _readable(frame: Frame | DataError) -> Frame:
    if isinstance(frame, DataError):
        raise frame
    return frame


def _continues(sequence: ForeignSequence, number: int) -> bool:
    """Return True if a frame continues the shot of the one before, in the same size."""
    now, before = sequence.layouts[number], sequence.layouts[number - sequence.step]
    return now.size == before.size and not sequence.outline(number).cut


def _moved(camera: Camera, change: Matrix, before: Layout, now: Layout) -> Camera:
    """Return the camera after the ``change`` since ``camera``; raises DataError if no camera moves so."""
    if np.array_equal(change, UNMOVED):
        return camera
    lifted = np.insert(change, 2, np.eye(4)[2], 0)  # rows x, y, 1/Z, w, of homogeneous positions
    try:
        view = np.linalg.inv(_seen(now)) @ np.linalg.inv(lifted) @ _seen(before) @ camera.world_to_view
    except np.linalg.LinAlgError:
        view = np.full((4, 4), np.nan)
    moved = Camera(view, FIRST.view_to_clip)
    try:
        check_camera(moved)
    except DataError:
        raise DataError("no camera moves as vectors and depth say") from None
    return moved


def with_cameras(sequence: ForeignSequence, cameras: Mapping[int, Camera]) -> ForeignSequence:
    """Return the same frames with these cameras, by number."""
    copy, intake = sequence.of_numbers(sequence.numbers), sequence.intake
    regions = {number: of_region(cameras.get(number, FIRST), layout) for number, layout in intake.layouts.items()}
    declared = {number: known._replace(camera=regions[number]) for number, known in intake.declared.items()}
    copy.intake = replace(intake, declared=declared)
    return copy


def with_fitted_cameras(sequence: FrameSequence, effects: Asked) -> FrameSequence:
    """Return the same frames with fitted cameras if they lack some, or as they are where none fit."""
    if lacks_camera(sequence, effects):
        fitted = fit_cameras(sequence)
        return with_cameras(sequence, fitted.cameras) if fitted.fits else sequence
    return sequence


def _seen(layout: Layout) -> Matrix:
    """Return the matrix from the view space of ``FIRST`` to (px, py, 1/Z, 1) of a picture, times the distance."""
    x, y, _, w = of_region(FIRST, layout).view_to_clip
    return np.array([x * (layout.width / 2), y * (-layout.height / 2), [0.0, 0.0, 0.0, 1.0], w])


def fitted_change(frame: Frame, before: Frame) -> tuple[Matrix, float]:
    """Return rows x, y, w [3, 4] of the map from (px, py, 1/Z, 1) to the frame before, and the share that follows it.

    Raises DataError if no camera explains enough vectors.
    """
    points = _points(frame)
    if points.x.size < LEAST_POINTS:
        raise _unsure(frame, "too few pixels have depth and a vector", LEAST_POINTS, points.x.size)
    wide, deep = max(float(np.abs(points.x).max()), 1.0), float(np.median(points.near))
    scaled = _Points(points.x / wide, points.y / wide, points.near / deep, points.u / wide, points.v / wide)
    allowed = (value("CAMERA_TOLERANCE") + value("CAMERA_SHARE") * points.length) / wide
    moved = _consensus(scaled, allowed)
    follows = _errors(moved, scaled) <= allowed
    share = float(follows.mean())
    if share < LEAST_FOLLOW:
        raise _unsure(frame, "too few vectors are of one camera", f"{LEAST_FOLLOW:.0%} or more", f"{share:.0%}")
    if (points.those(follows).length <= value("CAMERA_TOLERANCE")).mean() >= STANDS:
        return UNMOVED, float((points.length <= value("CAMERA_TOLERANCE")).mean())
    change = (moved + UNMOVED) * np.array([[wide], [wide], [1.0]]) / np.array([wide, wide, deep, 1.0])
    with np.errstate(all="ignore"):  # the caller refuses what no camera does
        change /= np.cbrt(np.linalg.det(change[:, [0, 1, 3]]))
    mantissa, exponent = np.frexp(change * _zoomed(change, points.those(follows), before))
    return np.ldexp(np.round(mantissa * 2**BITS), exponent - BITS), share


def _points(frame: Frame) -> _Points:
    """Return the points of a frame on surfaces and with a vector."""
    height, width = frame.depth.shape
    step = int(np.ceil(np.sqrt(max(1.0, height * width / MOST_POINTS))))
    row, column = (each.ravel() for each in np.mgrid[:height:step, :width:step])
    depth, motion = frame.depth[row, column].astype(np.float64), np.asarray(frame.motion)[row, column]
    usable = np.isfinite(depth) & (depth > 0) & np.isfinite(motion).all(1)
    x = column.astype(np.float64) + (0.5 + frame.jitter_px[0] - width / 2)
    y = row.astype(np.float64) + (0.5 + frame.jitter_px[1] - height / 2)
    u, v = motion.T.astype(np.float64)
    with np.errstate(divide="ignore"):
        return _Points(x, y, 1.0 / depth, u, v).those(usable)


def _consensus(points: _Points, allowed: Vector) -> Matrix:
    """Return the D [3, 4] that most ``points`` follow within the errors ``allowed``; 0 if none is better."""
    random = np.random.default_rng(0)
    some = random.permutation(points.x.size)[:RANKED]
    ranked, within = points.those(some), LOOSE[0] * allowed[some]
    best, share, tries = np.zeros((3, 4)), float((ranked.length <= within).mean()), 0
    while tries < MOST_TRIES and (1.0 - share**CHOSEN) ** tries > MISSED:
        ways, seen = _equations(ranked.those(random.integers(some.size, size=(TRIES, CHOSEN))))
        tried = _rows((np.linalg.pinv(ways, rcond=COLLINEAR) @ seen[..., None])[..., 0])
        shares = (_errors(tried, ranked) <= within).mean(-1)
        if shares.max() > share:
            best, share = tried[int(np.argmax(shares))], float(shares.max())
        tries += TRIES
    fits = [np.zeros((3, 4)), best]
    for loose in LOOSE:
        follows = _errors(fits[-1], points) <= loose * allowed
        if follows.sum() < LEAST_POINTS:
            break
        ways, seen = _equations(points.those(follows))
        fits.append(_rows(np.linalg.lstsq(ways, seen, rcond=COLLINEAR)[0]))
    return max(reversed(fits), key=lambda each: int((_errors(each, points) <= allowed).sum()))


def _equations(points: _Points) -> tuple[Vector, Vector]:
    """Return the equations [..., 2 n, 11] of D's rows x, y, w without the last number, and their right sides."""
    place, none = points.place, np.zeros_like(points.place)
    there = [-(by[..., None] * place[..., :3]) for by in (points.x + points.u, points.y + points.v)]
    by_x, by_y = np.concatenate([place, none, there[0]], -1), np.concatenate([none, place, there[1]], -1)
    return np.concatenate([by_x, by_y], -2), np.concatenate([points.u, points.v], -1)


def _rows(numbers: NDArray[Any]) -> Vector:
    """Return rows x, y, w of D [..., 3, 4] from its eleven open numbers [..., 11]."""
    return np.concatenate([numbers, np.zeros_like(numbers[..., :1])], -1).reshape(*numbers.shape[:-1], 3, 4)


def _errors(moved: Vector, points: _Points) -> Vector:
    """Return by how much the motion of each D [..., 3, 4] differs from the vectors, [..., n] in the unit of these."""
    dx, dy, dw = np.moveaxis(moved @ points.place.T, -2, 0)
    with np.errstate(all="ignore"):
        w = 1.0 + dw
        across = np.abs((dx - points.x * dw) / w - points.u)
        down = np.abs((dy - points.y * dw) / w - points.v)
        return np.where(w > 0.0, np.maximum(across, down), np.inf)


def _zoomed(change: Matrix, points: _Points, before: Frame) -> float:
    """Return the factor of ``change`` by which its points have the depth that the frame before shows there."""
    height, width = before.depth.shape
    column = points.x + points.u - (0.5 + before.jitter_px[0] - width / 2)
    row = points.y + points.v - (0.5 + before.jitter_px[1] - height / 2)
    with np.errstate(all="ignore"):
        shown = sample(1.0 / np.where(before.depth > 0, before.depth, np.nan), column, row)
        apart = np.log(points.near / (shown * (points.place @ change[2])))
    apart = apart[np.isfinite(apart)]
    if apart.size < LEAST_POINTS:
        return 1.0
    factor = float(np.median(apart))
    spread = 1.4826 * float(np.median(np.abs(apart - factor)))  # the standard deviation, if they lie normally
    error = 1.2533 * spread / np.sqrt(apart.size)  # of a median
    return float(np.exp(factor)) if abs(factor) > max(ZOOMS, SURE * error) else 1.0


def _unsure(frame: Frame, why: str, expected: object, found: object) -> DataError:
    return DataError(why, path=frame.path, frame=frame.index, expected=expected, found=found)
