"""Find jitter left in the projection, whose centre then moves to and fro by less than a pixel.

A resolve would follow it as camera motion, and samples would accumulate at wrong positions.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from cltaa.camera import is_still
from cltaa.frame import Frame
from cltaa.inputs.convert import without_jitter
from cltaa.lab.check.hypotheses import DOUBTFUL, MEANINGS, Finding, mistake, regress, to_and_fro
from cltaa.lab.check.jitter import LEAST_PAIRS, jitter_evidence
from cltaa.lab.check.registration import COVERED, Pair, Shot, Vector

LARGEST_HELD_PX = 1.0  # from the mean; a larger movement is a lens shift
LEAST_HELD_PX = 1e-4  # a smaller movement is rounding
NEAR_1, MOST_LEFT_PX = 0.1, 0.05  # largest difference of the gain from 1, and largest error of the fit


def check_projection_jitter(shot: Shot) -> list[Finding]:
    """Find a projection whose centre follows the declared jitter, frame by frame, without looking at pixels."""
    centre, jitter = _held(shot.frames)[1], np.array([frame.jitter_px for frame in shot.frames])
    jitter = jitter - jitter.mean(0)
    if len(shot.frames) < 3 or not jitter.any() or np.abs(centre).max() < LEAST_HELD_PX:
        return []
    fit = regress(centre, jitter, np.ones(len(jitter)))
    across, down = np.diag(fit.matrix).tolist()
    if max(abs(across - 1.0), abs(abs(down) - 1.0)) > NEAR_1 or fit.left > MOST_LEFT_PX:
        return []
    evidence = f"its centre moves by {across:.3f}, {down:.3f} x the declared jitter, to {fit.left:.1g} px"
    name, fix = "jittered", {"jittered": True}
    what = "the projection contains the jitter"
    if down < 0.0:  # the next round, with y flipped, finds the jitter
        if shot.frames[0].camera.view_to_clip[1, 1] > 0.0:
            return []
        name, (what, fix) = "y-flipped", MEANINGS["y-flipped"]
    return [mistake(f"camera-{name}", what, evidence, 0.98, fix)]


def check_held_jitter(shot: Shot) -> list[Finding]:
    """Find a projection whose centre moves to and fro, not as declared: a mistake if the pixels follow it, else a
    question."""
    if len(shot.pairs) < LEAST_PAIRS:
        return []
    _, held = _held(shot.frames)
    moved = np.sqrt((np.diff(held, axis=0) ** 2).mean(0))
    if not to_and_fro(held) or np.abs(held).max() > LARGEST_HELD_PX:
        return []
    readings = [_read_so(shot, shot.frames)]
    if shot.frames[0].camera.view_to_clip[1, 1] < 0.0:  # possibly a mistake, which also flips the jitter
        flip = MEANINGS["y-flipped"].change
        readings.append(_read_so(shot, [replace(frame, camera=flip(frame.camera)) for frame in shot.frames]))
    told = next(filter(None, map(jitter_evidence, readings)), "")
    centre = f"the projection's centre moves by {moved[0]:.2f}, {moved[1]:.2f} pixels from frame to frame"
    name, otherwise = "jitter-missing", "no jitter is declared, and"
    if any(np.any(frame.jitter_px) for frame in shot.frames):
        name, otherwise = "jitter-disagrees", "the declared jitter is another, and"
    follows = "as the pixels do: that is the jitter" if told else "to and fro: is that the jitter?"
    sure = 0.98 if told else DOUBTFUL
    evidence = told or "nothing that rests shows clearly whether the pixels move so"
    return [mistake(name, f"{otherwise} {centre} {follows}", evidence, sure, {"source": "projection"})]


def _held(frames: Sequence[Frame]) -> tuple[list[Frame], Vector]:
    """Return ``frames`` with the movement of their projections turned into jitter, and that jitter [n, 2] in pixels."""
    steady, held = without_jitter([frame.camera for frame in frames], [(frame.width, frame.height) for frame in frames])
    both = zip(frames, steady, held, strict=True)
    return [replace(frame, camera=camera, jitter_px=jitter) for frame, camera, jitter in both], np.array(held)


def _read_so(shot: Shot, frames: Sequence[Frame]) -> Shot:
    """Return ``shot`` with the jitter from the projections of ``frames``; matrices and depth define its motion."""
    read = copy(shot)
    read.frames, read.shifts = _held(frames)[0], None
    by_index = {frame.index: frame for frame in read.frames}
    read.pairs = [_by_camera(pair, by_index[pair.frame.index], by_index[pair.previous.index]) for pair in shot.pairs]
    return read


def _by_camera(pair: Pair, frame: Frame, previous: Frame) -> Pair:
    """Return ``pair`` with other frames; drops possibly wrong vectors that fill the picture of a moving camera."""
    kept = is_still(frame.camera, previous.camera) or np.isfinite(pair.own).all(0).mean() < COVERED
    own = pair.own if kept else np.full_like(pair.own, np.nan)
    return replace(pair, frame=frame, previous=previous, own=own)
