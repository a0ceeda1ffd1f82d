"""Conventions that a sequence cannot verify, so that nobody reads the check's silence as a confirmation.

A mistake without effect here may matter in the next shot that is read by the same profile.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from cltaa.camera import is_still
from cltaa.lab.check.camera import (
    CLEARLY_BETTER,
    DISAGREE,
    LEAST_MOTION_PX,
    MOST_PAIRS,
    camera_residual,
    middle_length,
    moving_pairs,
    residuals,
    tells_map,
)
from cltaa.lab.check.depth import is_coarse, tells_kind
from cltaa.lab.check.depth_travel import tells_kind_by_travel
from cltaa.lab.check.hypotheses import MEANINGS, PLAIN, Affine, linear_maps
from cltaa.lab.check.jitter import declared_jitter, jitter_evidence, settled_shifts
from cltaa.lab.check.motion import LEAST_EFFECT_PX, check_motion
from cltaa.lab.check.registration import COVERED, LEAST_POINTS, LEAST_SIDE, Pair, Shifts, Shot, Vector

MOST = 0.95  # quantile of the points, because a few near the edge move farther under any mistake
WHAT = {"inverse": "their direction", "y-flipped": "their y"}
UNIT = 2.0  # factor of a wrong unit of depth
VECTORS = {
    "negated": "their sign",
    "x-negated": "the sign of x",
    "y-flipped": "the sign of y",
    "swapped": "which is x",
    "scaled-2": "their size",
    "scaled-0.5": "their size",
}
AXES = {"the sign of x": 0, "the sign of y": 1}


def unverifiable(shot: Shot) -> list[str]:
    """Return one line for each convention whose mistake the check could not find in these frames."""
    if not shot.pairs:
        return [f"{_between_two(shot)}: no frame here follows another; give 8 or more in a row", *_depth(shot)]
    if shot.narrow:
        size = f"{shot.frames[0].width} x {shot.frames[0].height} pixels"
        return [f"{_between_two(shot)}: {size} are too small to tell, {LEAST_SIDE} on each side do", *_depth(shot)]
    return [*_camera(shot), *_depth(shot), *_motion(shot), *_jitter(shot)]


def _between_two(shot: Shot) -> str:
    """Name the conventions that need two consecutive frames, without a cut or gap, of sufficient size."""
    vectors = any(frame.motion is not None for frame in shot.frames)
    here = {
        "matrices": shot.has_camera,
        "the unit of depth": shot.has_camera and shot.has_depth,
        "vectors": vectors,
        "jitter": True,
    }
    return ", ".join(what for what, there in here.items() if there)


def _camera(shot: Shot) -> Iterator[str]:
    if not shot.has_camera:
        return
    pairs = moving_pairs(shot)
    if not pairs:
        yield "matrices: their direction, their y, a delay; and the unit of depth: the camera stands"
        return
    hidden = []
    for name, what in WHAT.items():
        if not _shows(pairs, [pair.motion_under(MEANINGS[name].change) for pair in pairs]):
            hidden.append(what)
    both = [(one, two) for one, two in zip(shot.pairs[1:], shot.pairs, strict=False) if _moves(one) or _moves(two)]
    late = [one.camera_motion(two.frame.camera, two.previous.camera) for one, two in both]
    if not _shows([one for one, _ in both], late):
        hidden.append("a delay")
    if hidden:
        yield f"matrices: {', '.join(hidden)}: the pictures match about as well either way"
    if shot.has_depth:
        nearer = [pair.camera_motion(inverse_depth=UNIT * pair.inverse_depth) for pair in pairs]
        if shot.frames[0].camera.orthographic or not _shows(pairs, nearer):
            yield "the unit of depth: the pictures match about as well with others"


def _depth(shot: Shot) -> Iterator[str]:
    if shot.has_depth and shot.has_camera and not (tells_kind(shot.frames) or tells_kind_by_travel(shot.frames)):
        coarse = "half precision rounds off by what planes of another kind would bend"
        flat = "no plane in view lies aslant, and the camera's motion does not tell"
        yield f"the kind of depth: {coarse if is_coarse(shot.frames) else flat}"


def _shows(pairs: Sequence[Pair], wrong: Sequence[Vector]) -> bool:
    """Return True if the check would find a mistake that turns the right motions into these, [2, n]."""
    if all(_far(pair, motion) for pair, motion in zip(pairs, wrong, strict=True)):
        return True  # by the vectors, which fill the picture
    chosen = slice(None, None, max(1, len(pairs) // MOST_PAIRS))
    right = residuals(pairs[chosen])
    spoilt = [camera_residual(pair, motion) for pair, motion in zip(pairs[chosen], wrong[chosen], strict=True)]
    return bool(np.mean(right) <= CLEARLY_BETTER * np.mean(spoilt))


def _far(pair: Pair, wrong: Vector) -> bool:
    """Return True if vectors fill the picture and the wrong motion is far from the right one at most points."""
    if np.isfinite(pair.own).all(0).mean() < COVERED:
        return False
    right = pair.camera_motion()
    return middle_length(wrong - right) > DISAGREE * max(middle_length(wrong), LEAST_MOTION_PX)


def _moves(pair: Pair) -> bool:
    return not is_still(pair.frame.camera, pair.previous.camera)


def _motion(shot: Shot) -> Iterator[str]:
    """Yield the conventions of vectors that are too few, too short, or all of one direction."""
    own = [pair.own[:, pair.moving & pair.usable] for pair in shot.pairs if pair.frame.motion is not None]
    own = [vectors for vectors in own if vectors.size]
    if not any(pair.frame.motion is not None for pair in shot.pairs):
        return
    if not any(vectors.shape[1] >= LEAST_POINTS for vectors in own) and any(vectors.any() for vectors in own):
        yield "the vectors' sign, axes and unit: too few pixels hold one"
        return
    if not own and any(np.any(pair.own[np.isfinite(pair.own)]) for pair in shot.pairs):
        yield "the vectors' sign, axes and unit: before a camera that stands all are alike"
        return
    longest = max((float(np.quantile(np.hypot(*vectors), MOST)) for vectors in own), default=0.0)
    if longest < LEAST_EFFECT_PX:
        yield f"the vectors' sign, axes and unit: none is longer than {LEAST_EFFECT_PX:g} px"
        return
    settled = settled_shifts(shot)
    maps = linear_maps(*shot.window)
    hidden = [what for name, what in VECTORS.items() if not _shows_map(shot, settled, name, Affine(maps[name]))]
    if not all(_shows_leak(shot, settled, leak) for leak in shot.leaks.values()):
        hidden.append("jitter in them")
    for what, axis in AXES.items():
        # A flipped sign changes a vector by twice its component on that axis.
        if max(2 * float(np.sqrt((vectors[axis] ** 2).mean())) for vectors in own) < LEAST_EFFECT_PX:
            yield f"the vectors: {what}: nothing moves that way"
            hidden = [other for other in hidden if other != what]
    if hidden:
        yield f"the vectors: {', '.join(dict.fromkeys(hidden))}: the pictures match about as well either way"


def _shows_map(shot: Shot, settled: Shifts, name: str, meant: Affine) -> bool:
    """Return True if the check finds that ``meant`` is missing after the declared vectors, with which the shifts were
    ``settled``, were mapped by its inverse."""
    wrong = Affine(np.asarray(np.linalg.inv(meant.matrix), np.float64))
    return tells_map(shot, wrong) or _finds(shot, settled, [wrong(p.own) for p in shot.pairs], {name: meant})


def _shows_leak(shot: Shot, settled: Shifts, leak: int) -> bool:
    """Return True if the check finds ``leak`` times the change of jitter after it was added to the vectors."""
    return _finds(shot, settled, [p.own + leak * p.jitter_change[:, None] for p in shot.pairs], {})


def _finds(shot: Shot, settled: Shifts, vectors: Sequence[Vector], maps: Mapping[str, Affine]) -> bool:
    spoilt = copy(shot)
    spoilt.pairs = [replace(p, own=own) for p, own in zip(shot.pairs, vectors, strict=True)]
    found = check_motion(spoilt, settled, {"": PLAIN, **maps})
    return any(finding.settled.mistake for finding in found)


def _jitter(shot: Shot) -> Iterator[str]:
    if np.ptp(declared_jitter(shot.frames), axis=0).any() and not jitter_evidence(shot):
        yield "the jitter: its sign, axes and size: nothing that rests shows it clearly"
