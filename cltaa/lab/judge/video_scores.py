"""Scores of single faults of a resolve: ghosting, flicker, blur, aliasing; formulas in ``docs/metrics.md``.

All compare display images, so that a fault counts as it looks, with the truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import import_extra
from cltaa.frame import Frame, Image
from cltaa.io.display import to_display
from cltaa.lab.judge.correspondence import Correspondence, Mask, correspondence
from cltaa.lab.judge.metrics import Measure

Array = NDArray[np.float64]

TRAIL = 8  # frames for which a disoccluded pixel is watched for its occluder
LEAST_CHANGE = 0.1  # least change of the truth's display value at a watched disocclusion
LEAST_WATCHED = 512  # least pixels, over all frames, for ghosting; with fewer, chance decides
STEADY_PX = 0.5  # largest difference of the motion within 3x3 at a tracked pixel


SCORES = (  # of a sequence; for all, lower is better
    Measure("ghosting", "share of what stood there before that still shows at disoccluded pixels", ".3f"),
    Measure("flicker", "change from frame to frame that is not in the truth, rms of display values"),
    Measure("blur", "share of the truth's finest detail that is lost", ".3f"),
    Measure("aliasing", "fine detail that no filter of the truth explains, rms of display values"),
)


@dataclass(slots=True)
class Sums:
    """Numerators and denominators of the scores of some frames; totals give the scores of all frames."""

    stale_product: float = 0.0
    stale_square: float = 0.0
    stale_pixels: int = 0
    flicker_square: float = 0.0
    flicker_count: int = 0
    detail_product: float = 0.0  # of the test's fine detail and the truth's
    detail_square: float = 0.0  # of the truth's fine detail
    false_square: float = 0.0  # of the test's fine detail that no filter of the truth explains
    false_count: int = 0  # number of values in that sum

    def __iadd__(self, other: Sums) -> Sums:
        """Add the sums of other frames."""
        for field in fields(self):
            setattr(self, field.name, getattr(self, field.name) + getattr(other, field.name))
        return self

    def scores(self) -> dict[str, float]:
        """Return the value of each score; NaN if undefined: nothing disoccluded, no previous frame, no detail."""
        return {
            "ghosting": _ratio(self.stale_product, self.stale_square * (self.stale_pixels >= LEAST_WATCHED)),
            "flicker": math.sqrt(_ratio(self.flicker_square, self.flicker_count)),
            "blur": 1 - _ratio(self.detail_product, self.detail_square),
            "aliasing": math.sqrt(_ratio(self.false_square, self.false_count)),
        }


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole > 0 else math.nan


@dataclass(slots=True)
class _Past:
    """Data of the previous frame."""

    frame: Frame
    truth: Array
    errors: list[Array]
    stale: Array
    age: NDArray[np.int64]
    watched: Mask


class VideoScores:
    """Judges tests against one truth, frame by frame in order; restarts at a cut or a gap in the numbers.

    Takes several tests at once, because most of the work is for the truth. Raises UsageError without scipy.
    """

    def __init__(self, tests: int = 1, stops: float = 0.0) -> None:
        import_ndimage()  # fails now and not after the first frame
        self.totals = [Sums() for _ in range(tests)]
        self._stops = stops
        self._past: _Past | None = None
        self.fresh: Mask = np.zeros((0, 0), np.bool_)  # [H, W]: disoccluded in the last frame, with no edge beside

    def add(self, frame: Frame, truth: Image, tests: list[Image], *, judged: bool = True) -> list[Sums]:
        """Judge one frame: ``frame`` as captured, the truth and each test, linear [H, W, 3]; judges a repeated test
        once.

        With ``judged`` False it only stores the frame for the next one, and returns no sums.
        """
        shown = to_display(truth, self._stops).astype(np.float64)
        given = {id(test): test for test in tests}
        different = {key: to_display(test, self._stops).astype(np.float64) for key, test in given.items()}
        errors = {key: test - shown for key, test in different.items()}
        past = self._past
        if past is not None and (frame.cut or frame.index != past.frame.index + frame.step):
            past = None
        found = None if past is None else correspondence(frame, past.frame)
        stale, age = _follow_stale(shown, past, found)
        watched = age > 0
        self.fresh = (age == 1) & ~found.edge if found is not None else np.zeros_like(watched)
        self._past = _Past(frame, shown, [errors[id(test)] for test in tests], stale, age, watched)
        if not judged:
            return []
        trail = _Trail(shown, stale, watched, found)
        path = None if past is None or found is None else _Path(found, _steady(found, watched, past.watched))
        details = dict(zip(different, judge_detail(shown, [*different.values()], ~_grown(watched)), strict=True))
        befores = [None] * len(tests) if past is None else past.errors
        known: dict[tuple[int, int], Sums] = {}
        results = []
        for total, test, before in zip(self.totals, tests, befores, strict=True):
            key = id(test), id(before)
            if key not in known:
                known[key] = _sums(errors[id(test)], before, details[id(test)], trail, path)
            total += known[key]
            results.append(known[key])
        return results


def _sums(error: Array, before: Array | None, detail: Sums, trail: _Trail, path: _Path | None) -> Sums:
    sums = replace(detail)
    if before is not None and path is not None:
        sums += trail.ghosting(error)
        sums += path.flicker(error, before)
    return sums


def _follow_stale(truth: Array, past: _Past | None, found: Correspondence | None) -> tuple[Array, NDArray[np.int64]]:
    """Return the occluder's colour at disoccluded pixels [H, W, 3], and the frames since, from 1 (0: none) [H, W]."""
    if past is None or found is None:
        return truth, np.zeros(truth.shape[:2], np.int64)
    before = past.truth[found.row, found.column]
    fresh = found.disoccluded & (np.abs(before - truth).max(-1) >= LEAST_CHANGE)
    carried = past.age[found.row, found.column] + 1
    carried[~found.same | (carried == 1) | (carried > TRAIL)] = 0
    age = np.where(fresh, 1, carried)
    stale = np.where(fresh[..., None], before, past.stale[found.row, found.column])
    return np.where((age > 0)[..., None], stale, truth), age


class _Trail:
    """Disoccluded pixels of one frame, and the ghost of their occluder.

    Only pixels without an edge count: with an edge in the pixel, the fact that its one captured sample is behind the
    edge already biases the error of this frame.
    """

    def __init__(self, truth: Array, stale: Array, watched: Mask, found: Correspondence | None) -> None:
        judged = watched & ~found.edge if found is not None else np.zeros_like(watched)
        self._judged, self._watched = np.flatnonzero(judged), np.flatnonzero(watched)
        if not self._judged.size:
            return
        self._blur = (blurred(truth) - truth)[judged].ravel()
        self._blur_square = float(self._blur @ self._blur)
        self._ghost = self._unexplained((stale - truth)[judged].ravel())
        self._square = float(self._ghost @ self._ghost)

    def _unexplained(self, values: Array) -> Array:
        """Return the part of ``values`` that a blur of the truth does not explain."""
        if self._blur_square > 0:
            values = values - self._blur * (float(values @ self._blur) / self._blur_square)
        return values

    def ghosting(self, error: Array) -> Sums:
        """Regress the error on the occluder's colour, together with the effect of a blur of the truth.

        The part that a blur explains is subtracted from both sides (Frisch-Waugh), so that the rest is a plain ratio of
        sums. An error of the whole picture (all too bright) is no ghost, so the mean error of other pixels is
        subtracted.
        """
        if not self._judged.size:
            return Sums()
        pixels = error.reshape(-1, error.shape[-1])
        others = max(1, len(pixels) - self._watched.size)
        elsewhere = (pixels.sum(0) - pixels[self._watched].sum(0)) / others
        wrong = self._unexplained((pixels[self._judged] - elsewhere).ravel())
        return Sums(stale_product=float(wrong @ self._ghost), stale_square=self._square, stale_pixels=self._judged.size)


def _steady(found: Correspondence, watched: Mask, watched_before: Mask) -> Mask:
    """Return pixels that can be tracked from the previous frame: one surface, one motion around it, no disocclusion."""
    ndimage = import_ndimage()
    motion = found.motion
    spread = ndimage.maximum_filter(motion, (3, 3, 1)) - ndimage.minimum_filter(motion, (3, 3, 1))
    before = _grown(watched_before)[found.row, found.column]
    steady: Mask = found.same & (spread.max(-1) <= STEADY_PX) & ~_grown(watched) & ~before
    return steady


class _Path:
    """Pixels tracked from the previous frame, and their previous positions."""

    def __init__(self, found: Correspondence, steady: Mask) -> None:
        moving = steady & (found.motion != 0).any(-1)
        self._stayed, self._moved = np.flatnonzero(steady & ~moving), np.flatnonzero(moving)
        self._places = found.y[moving] - 0.5, found.x[moving] - 0.5

    def flicker(self, error: Array, before: Array) -> Sums:
        """Return the change of the error along the motion, which is the test's change beyond the truth's."""
        pixels, earlier = (image.reshape(-1, image.shape[-1]) for image in (error, before))
        changes = [pixels[self._stayed] - earlier[self._stayed]]
        if self._moved.size:
            planes = np.moveaxis(before, -1, 0)  # sampled by cubic B-spline interpolation, with repeated edges
            there = [import_ndimage().map_coordinates(plane, self._places, order=3, mode="nearest") for plane in planes]
            changes.append(pixels[self._moved] - np.stack(there, axis=-1))
        return Sums(
            flicker_square=math.fsum(float((change**2).sum()) for change in changes),
            flicker_count=sum(change.size for change in changes),
        )


def _grown(mask: Mask) -> Mask:
    """Return the mask grown by the reach of the fine-detail filter."""
    grown: Mask = import_ndimage().maximum_filter(mask, 2 * REACH + 1)
    return grown


TILE = 32  # side in pixels of the tiles within which a blur is assumed constant
# Binomial filters of 3 and 5 taps; fine detail is the part that the wide one removes.
NARROW, WIDE = np.array([1, 2, 1]) / 4, np.array([1, 4, 6, 4, 1]) / 16
SLOPE = np.array([-0.5, 0, 0.5])
REACH = 2  # radius of the wide filter in pixels
MARGIN = 2 * REACH  # radius of two such filters in succession
LEAST_ROWS = 10  # least judged values per filter of the family; with fewer the family explains anything
RANK = 1e-10  # smaller eigenvalues of a tile's Gram matrix, relative to the largest, are only rounding


def import_ndimage() -> Any:
    """Import scipy's filters; raises UsageError that says what to install."""
    return import_extra("scipy.ndimage", package="scipy", extra="metrics", purpose="judging a sequence in time")


def blurred(image: Array) -> Array:
    """Apply the wide filter along both axes of [H, W, ...]; edges repeat."""
    for axis in (0, 1):
        margin = [(0, 0)] * image.ndim
        margin[axis] = (REACH, REACH)
        # Summing whole slices takes half the time of scipy's filter.
        padded = np.moveaxis(np.pad(image, margin, mode="edge"), axis, 0)
        length = image.shape[axis]
        taps = (weight * padded[at : at + length] for at, weight in enumerate(WIDE))
        image = np.moveaxis(sum(taps, start=np.zeros(())), 0, axis)
    return image


def judge_detail(truth: Array, tests: list[Array], judged: Mask) -> list[Sums]:
    """Compare the fine detail of each test with the truth's, display values [H, W, 3], where ``judged`` [H, W].

    Leaves out the margin where the filters reach outside the image. Works in bands of tiles, so that only one band of
    the filter family is in memory.
    """
    inside = np.zeros_like(judged)
    inside[MARGIN:-MARGIN, MARGIN:-MARGIN] = judged[MARGIN:-MARGIN, MARGIN:-MARGIN]
    judged = inside
    truth_fine = truth - blurred(truth)
    tests_fine = [test - blurred(test) for test in tests]
    judged_fine = np.where(judged[..., None], truth_fine, 0.0)
    square = float((judged_fine**2).sum())
    false = np.zeros((len(tests), 2))
    for top in range(0, truth.shape[0], TILE):
        band = np.s_[top : top + TILE]
        family = _family(truth, top)
        false += _unexplained(family, np.stack([fine[band] for fine in tests_fine]), judged[band])
    return [
        Sums(
            detail_product=float((fine * judged_fine).sum()),
            detail_square=square,
            false_square=float(rest),
            false_count=int(count),
        )
        for fine, (rest, count) in zip(tests_fine, false, strict=True)
    ]


def _family(truth: Array, top: int) -> Array:
    """Return the truth's fine detail in one band after 3 widths of blur per axis and after shifts, [rows, W, 3, 11]."""
    ndimage = import_ndimage()
    rows = np.arange(top - MARGIN, min(top + TILE, truth.shape[0]) + MARGIN)
    slab = truth[np.clip(rows, 0, truth.shape[0] - 1)]

    def along(image: Array, kernel: Array, axis: int) -> Array:
        filtered: Array = ndimage.correlate1d(image, kernel, axis, mode="nearest")
        return filtered

    across = [slab, along(slab, NARROW, 1), along(slab, WIDE, 1)]
    both = [filtered for image in across for filtered in (image, along(image, NARROW, 0), along(image, WIDE, 0))]
    shifts = [along(slab, SLOPE, axis) for axis in (0, 1)]
    return np.stack([(image - blurred(image))[MARGIN:-MARGIN] for image in (*both, *shifts)], axis=-1)


def _unexplained(family: Array, tests: Array, judged: Mask) -> Array:
    """Return sum of squares and count, [tests, 2], of the residual of each test after least squares over each tile.

    ``family`` [rows, W, 3, F], ``tests`` [tests, rows, W, 3]. The normal equations suffice for the sum: it is
    s.s - (F s)' G^-1 (F s) with the Gram matrix G of the tile.
    """
    result = np.zeros((len(tests), 2))
    for left in range(0, judged.shape[1], TILE):
        seen = judged[:, left : left + TILE]
        filters = family[:, left : left + TILE][seen].reshape(-1, family.shape[-1])
        if len(filters) < LEAST_ROWS * family.shape[-1]:
            continue
        inverse = np.linalg.pinv(filters.T @ filters, rcond=RANK, hermitian=True)
        for sums, test in zip(result, tests, strict=True):  # one at a time, so that other tests change no bit
            values = test[:, left : left + TILE][seen].ravel()
            explained = values @ filters
            sums += max(float(values @ values - explained @ inverse @ explained), 0.0), len(filters)
    return result
