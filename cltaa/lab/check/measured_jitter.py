"""Measure the jitter of each frame from the pixels alone, and write it as a side file.

The shift between two frames is their change of jitter. Sums of such changes drift, so each frame is also registered
with frames farther back, and least squares reconciles all. Pixels do not show the mean of the jitter: it is taken as 0.

Where vectors fill the picture, matrices and depth show which of them are the camera's, whatever jitter they contain.
Without these, vectors lead from frame to frame, and what all share of a motion to and fro is jitter in them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cltaa.errors import DataError
from cltaa.frame import Frame
from cltaa.inputs.bilinear import sample
from cltaa.inputs.side_file import Side
from cltaa.io.atomic import atomic_path
from cltaa.io.exr_frame import MATRICES
from cltaa.io.sequence import FrameSequence
from cltaa.lab.check.camera import AGREE
from cltaa.lab.check.hypotheses import LEAST_SHIFT_PX, regress, to_and_fro
from cltaa.lab.check.jitter import CENTRED_PX, LEAST_PAIRS, stays_in_pixel
from cltaa.lab.check.motion import fills, follows, shared_offset
from cltaa.lab.check.registration import Mask, Pair, Shot, Vector, measure_shifts
from cltaa.printable import counted
from cltaa.progress import track

LAGS = (1, 2, 4, 8, 16)  # frames back; so many frames are in memory
# In 28 captured scenes of 320 x 180 the shifts disagreed by at most 0.076 px, and the jitter was right to 0.08 px; of
# 96 x 54, corridor was accepted with an error of 0.15 px.
MOST_LEFT_PX = 0.1
FOLLOWED = 0.25  # least share of the measured changes that vectors follow, if they contain some


class _Change(NamedTuple):
    """The change of jitter [2] since the frame ``lag`` places before the one at ``place``; if ``led``, less what the
    vectors contain of it."""

    place: int
    lag: int
    shift: Vector
    led: bool


class _Offset(NamedTuple):
    """What the vectors of a frame that led to the one before share, [2] in pixels, and whether most of them do."""

    offset: Vector
    shared: bool


def measured_jitter(sequence: FrameSequence) -> dict[int, Vector]:
    """Return the jitter [2] in pixels by frame number, with mean 0.

    Raises what reading raises, and DataError if the pixels leave it uncertain.
    """
    has_camera = _has_camera(sequence)
    count, held = len(sequence), list[Frame]()
    changes, offsets = list[_Change](), dict[int, _Offset]()
    for place, given in enumerate(track(sequence, count, "measuring")):
        frame = replace(given, jitter_px=(0.0, 0.0))
        held = [] if frame.cut else held
        for change, offset in _changes(frame, held, place, has_camera=has_camera):
            changes.append(change)
            if offset is not None:
                offsets[place] = offset
        held = [*held, frame][-LAGS[-1] :]
    if len(changes) < 2 * (count - 1):  # twice what determines the jitter, so that most of it is seen in two ways
        what, found = "too few pairs of frames show their shift", f"{len(changes)} of {counted(count, 'frame')}"
        cure = "give five frames or more of one shot, with matrices and depth if the camera moves"
        raise _unsure(sequence, what, f"{2 * (count - 1)} pairs", found, cure)
    held_by = _held(sequence, changes, offsets)
    rows, shifts = list[Vector](), list[Vector]()
    for place, lag, shift, led in changes:
        row = np.zeros(count)
        row[place], row[place - lag] = 1.0, -1.0
        rows.append(row)
        shifts.append(shift + (held_by[place - lag + 1 : place + 1].sum(0) if led else 0.0))
    ways, seen = np.array([*rows, np.ones(count)]), np.array([*shifts, np.zeros(2)])
    jitter, _, rank, _ = np.linalg.lstsq(ways, seen, rcond=None)
    if rank < count:
        what, cure = "some frames match none of the others", "measure each shot for itself, with --frames"
        raise _unsure(sequence, what, "one shot", f"{count - int(rank) + 1} separate parts", cure)
    left, size = (float(np.sqrt((each**2).sum(1).mean())) for each in (seen - ways @ jitter, jitter))
    if size < LEAST_SHIFT_PX:
        what, cure = "the pixels show no jitter", "resolve without a file of jitter"
        if offsets and not _has_camera(sequence):
            what = "the pixels show no jitter that their vectors do not contain"
            cure = "give matrices and depth, which tell what the vectors contain, or resolve without a file of jitter"
        raise _unsure(sequence, what, f"{LEAST_SHIFT_PX:g} px rms or more", f"{size:.3f} px", cure)
    largest = float(np.abs(jitter).max())
    if left > MOST_LEFT_PX or largest > CENTRED_PX:
        what, found = "the shifts of the picture fit no jitter", f"{left:.2f} px and {largest:.2f} px"
        expected = f"agreement within {MOST_LEFT_PX:g} px rms, and at most {CENTRED_PX:g} px"
        # Without matrices the check may find nothing but this jitter, and would lead back here.
        first = (
            "first mend what"
            if _has_camera(sequence)
            else "give matrices and depth if the camera moves, mend what else"
        )
        raise _unsure(sequence, what, expected, found, f"{first} cltaa check finds, or give the jitter itself")
    return dict(zip(sequence.numbers, jitter, strict=True))


def _changes(
    frame: Frame, held: Sequence[Frame], place: int, *, has_camera: bool
) -> Iterator[tuple[_Change, _Offset | None]]:
    """Yield the changes of jitter since some of the frames ``held``, and the offset of vectors that led to them."""
    by_matrices = has_camera and bool(np.isfinite(frame.depth).any())
    rests: Mask | None = None
    offset: _Offset | None = None
    for lag in (lag for lag in LAGS if lag <= len(held)):
        before = held[-lag]
        following = replace(frame, step=frame.index - before.index)
        shot = Shot([before, following], (frame.width, frame.height), has_camera=has_camera)
        (pair,) = shot.pairs
        led, own = fills(pair), pair.own.copy()
        if led and lag == 1:
            offset = _Offset(*shared_offset(pair))
        if offset is not None and by_matrices:
            # Without its jitter the camera's motion is known to a share of it.
            rests = follows(pair, offset.offset, AGREE) if rests is None else rests
            pair.own[:, rests] = np.nan
        (fit,), anchored = measure_shifts(shot)
        led = led and not anchored
        if led and (by_matrices or lag > 1):
            pair.own, shot.shifts = _led_back(own, pair, held[len(held) - lag + 1 :]), None
            pair.usable &= np.isfinite(pair.own).all(0)
            (fit,), _ = measure_shifts(shot)
        if fit is not None and (anchored or led or frame.motion is None or lag == 1):  # a vector leads one frame back
            yield _Change(place, lag, fit.shift, led), offset if led else None


def _led_back(own: Vector, pair: Pair, between: Sequence[Frame]) -> Vector:
    """Return the vectors ``own`` of ``pair`` followed through the frames ``between``, [2, n]; NaN where these have
    none."""
    led = own.copy()
    for frame in reversed(between):
        if frame.motion is None:
            return np.full_like(own, np.nan)
        led += sample(np.ascontiguousarray(frame.motion.transpose(2, 0, 1)), pair.x + led[0], pair.y + led[1])
    return led


def _held(sequence: FrameSequence, changes: Sequence[_Change], offsets: Mapping[int, _Offset]) -> Vector:
    """Return the change of jitter [n, 2] that the vectors of each frame contain.

    Raises DataError if it is not to be told from the motion of a camera.
    """
    held = np.zeros((len(sequence), 2))
    shifts = np.array([each.shift for each in changes if each.led and each.lag == 1])
    known = np.array([each.offset for each in offsets.values()])
    if len(shifts) != len(known) or len(known) < LEAST_PAIRS:
        return held
    # Vectors that hold the jitter with the other sign follow minus half of what is measured then.
    follow = regress(np.diff(known, n=2, axis=0), np.diff(shifts, n=2, axis=0), np.ones(len(known) - 2)).matrix
    if not to_and_fro(known) and abs(np.trace(follow)) / 2.0 < FOLLOWED:
        return held
    if not (all(each.shared for each in offsets.values()) and stays_in_pixel(known)):
        what, cure = "the vectors go to and fro: by jitter or by the camera", "give the jitter itself"
        if not _has_camera(sequence):
            cure = "give matrices and depth, which tell"
        raise _unsure(sequence, what, "vectors that rest or move on", f"{np.hypot(*known.std(0)):.2f} px rms", cure)
    held[[*offsets]] = known
    return held


def _has_camera(sequence: FrameSequence) -> bool:
    return sequence.undeclared.isdisjoint(MATRICES)


def _unsure(sequence: FrameSequence, why: str, expected: str, found: str, cure: str) -> DataError:
    what = f"the jitter is not measured: {why}"
    return DataError(what, path=sequence.folder, expected=expected, found=found, cure=cure)


def write_jitter(path: Path, jitter: dict[int, Vector], side: dict[int, Side]) -> None:
    """Write ``jitter`` as a side file in JSON, with what else ``side`` gives for the same frames.

    Raises OutputError and StorageError.
    """
    frames: dict[int, dict[str, Any]] = {}
    for number, offset in jitter.items():
        rest = side[number]._asdict() if number in side else {}
        told = {**rest, "jitter_px": offset}
        frames[number] = {key: np.asarray(value, float).tolist() for key, value in told.items() if value is not None}
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps({"frames": frames}, indent=1) + "\n", encoding="utf-8")
