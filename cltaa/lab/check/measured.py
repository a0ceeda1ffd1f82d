"""Measure the jitter of each frame from the pixels alone, and write it as a side file.

The shift between two frames is their change of jitter. Sums of such changes drift, so each frame is also registered
with frames farther back, and least squares reconciles all. Pixels do not show the mean of the jitter: it is taken as 0.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cltaa.errors import DataError
from cltaa.frame import Frame
from cltaa.inputs.side_file import Side
from cltaa.io.atomic import atomic_path
from cltaa.io.exr_frame import MATRICES
from cltaa.io.sequence import FrameSequence
from cltaa.lab.check.hypotheses import LEAST_SHIFT_PX
from cltaa.lab.check.jitter import CENTRED_PX
from cltaa.lab.check.registration import Shot, Vector, measure_shifts
from cltaa.printable import counted
from cltaa.progress import track

LAGS = (1, 2, 4, 8, 16)  # frames back; so many frames are in memory
# In 28 captured scenes of 320 x 180 the shifts disagreed by at most 0.076 px, and the jitter was right to 0.08 px; of
# 96 x 54, corridor was accepted with an error of 0.15 px.
MOST_LEFT_PX = 0.1


def measured_jitter(sequence: FrameSequence) -> dict[int, Vector]:
    """Return the jitter [2] in pixels by frame number, with mean 0.

    Raises what reading raises, and DataError if the pixels leave it uncertain.
    """
    has_camera = sequence.undeclared.isdisjoint(MATRICES)
    held, rows, shifts = list[Frame](), list[Vector](), list[Vector]()
    count = len(sequence)
    for place, given in enumerate(track(sequence, count, "measuring")):
        frame = replace(given, jitter_px=(0.0, 0.0))
        held = [] if frame.cut else held
        for lag in (lag for lag in LAGS if lag <= len(held)):
            before = held[-lag]
            pair = [before, replace(frame, step=frame.index - before.index)]
            shot = Shot(pair, (frame.width, frame.height), has_camera=has_camera)
            (fit,), anchored = measure_shifts(shot)
            if fit is not None and (anchored or frame.motion is None or lag == 1):  # a vector leads one frame back
                row = np.zeros(count)
                row[place], row[place - lag] = 1.0, -1.0
                rows.append(row)
                shifts.append(fit.shift)
        held = [*held, frame][-LAGS[-1] :]
    if len(rows) < 2 * (count - 1):  # twice what determines the jitter, so that most of it is seen in two ways
        what, found = "too few pairs of frames show their shift", f"{len(rows)} of {counted(count, 'frame')}"
        cure = "give five frames or more of one shot, with matrices and depth if the camera moves"
        raise _unsure(sequence, what, f"{2 * (count - 1)} pairs", found, cure)
    ways, seen = np.array([*rows, np.ones(count)]), np.array([*shifts, np.zeros(2)])
    jitter, _, rank, _ = np.linalg.lstsq(ways, seen, rcond=None)
    if rank < count:
        what, cure = "some frames match none of the others", "measure each shot for itself, with --frames"
        raise _unsure(sequence, what, "one shot", f"{count - int(rank) + 1} separate parts", cure)
    left, size = (float(np.sqrt((each**2).sum(1).mean())) for each in (seen - ways @ jitter, jitter))
    if size < LEAST_SHIFT_PX:
        what, cure = "the pixels show no jitter", "resolve without a file of jitter"
        raise _unsure(sequence, what, f"{LEAST_SHIFT_PX:g} px rms or more", f"{size:.3f} px", cure)
    largest = float(np.abs(jitter).max())
    if left > MOST_LEFT_PX or largest > CENTRED_PX:
        what, found = "the shifts of the picture fit no jitter", f"{left:.2f} px and {largest:.2f} px"
        expected = f"agreement within {MOST_LEFT_PX:g} px rms, and at most {CENTRED_PX:g} px"
        raise _unsure(sequence, what, expected, found, "first mend what cltaa check finds, or give the jitter itself")
    return dict(zip(sequence.numbers, jitter, strict=True))


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
