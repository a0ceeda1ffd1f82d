"""Check whether camera matrices follow the declared conventions, or are transposed, inverted, flipped or delayed.

If an engine writes both matrices and motion vectors, most pixels have no own motion, and there both must agree. Only
the right reading makes tens of thousands of numbers agree. Slow motion and coarse samples, which hide how well pictures
match, cannot hide that.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.camera import is_still, sky_inverse_depth
from cltaa.core.frame_checks import check_camera
from cltaa.errors import DataError
from cltaa.frame import Frame
from cltaa.lab.check.hypotheses import (
    COMBINED,
    DOUBTFUL,
    MEANINGS,
    PLAIN,
    SIGNS,
    SURE,
    Affine,
    Change,
    Finding,
    Meaning,
    affine_maps,
    mistake,
    scaled,
    spoken,
    sureness,
    whole,
)
from cltaa.lab.check.registration import COVERED, LEAST_POINTS, Pair, Shot, Vector, fit_shift, residual_of, seen_before
from cltaa.printable import counted

MOST_PAIRS, MOST_POINTS = 6, 3000  # tested for each of a dozen meanings; more only cost time
LARGEST_MISMATCH = 0.5  # largest residual of a reported meaning
CLEARLY_BETTER = 0.85  # residual of the winner over that as declared
LEAST_LATE = 4  # pairs in which vectors are late, and half of all: a shot may begin with vectors of 0
SHOWN = 0.97  # residual of the winner over that of a camera that stands: plain things do not show how it moves


def sound(frame: Frame, change: Change | None = None) -> bool:
    """Return True if the camera of a frame, after ``change``, is valid."""
    try:
        check_camera(frame.camera if change is None else change(frame.camera))
    except (DataError, np.linalg.LinAlgError):
        return False
    return True


def check_structure(frames: Sequence[Frame]) -> tuple[list[Finding], Change | None]:
    """Return findings about invalid matrices, and the change that makes them valid (None: unknown or not needed)."""
    wrong = [frame for frame in frames if not sound(frame)]
    if not wrong:
        return [], None
    able = [name for name, meant in MEANINGS.items() if all(sound(frame, meant.change) for frame in frames)]
    if able:
        mismatch = {name: _mismatch(frames, MEANINGS[name].change) if len(able) > 1 else 0.0 for name in able}
        name = min(able, key=lambda name: mismatch[name])
        alike = [other for other in able if other != name and CLEARLY_BETTER * mismatch[other] <= mismatch[name]]
        what, fix = MEANINGS[name]
        row = " ".join(f"{number:g}" for number in wrong[0].camera.world_to_view[3])
        clip = " ".join(f"{number:g}" for number in wrong[0].camera.view_to_clip[3])
        evidence = f"last rows {row} and {clip} as read are no camera's, and are one's if {what}"
        if alike:
            evidence += f"; or {', '.join(alike)}, under which the pictures match about as well"
        return [mistake(f"camera-{name}", what, evidence, 0.95, fix)], MEANINGS[name].change
    evidence = f"frame {wrong[0].index}: neither as read nor transposed, inverted or flipped"
    return [mistake("camera-wrong", "the matrices are no camera", evidence, 0.95)], None


def _mismatch(frames: Sequence[Frame], change: Change) -> float:
    """Return the mean residual of frames under changed matrices; 0 for a still camera, which any matrices fit."""
    size = frames[0].width, frames[0].height  # only vectors need the display window
    shot = Shot([replace(frame, camera=change(frame.camera)) for frame in frames], size)
    pairs = moving_pairs(shot)
    return float(residuals(pairs).mean()) if pairs else 0.0


def check_travel(shot: Shot) -> list[Finding]:
    """Judge other meanings of the matrices by how well the previous frame, reprojected by them, matches this one."""
    pairs = moving_pairs(shot)
    if len(pairs) < 2 or not shot.has_camera:
        return []
    declared = residuals(pairs)
    able = {name: meant for name, meant in MEANINGS.items() if all(sound(f, meant.change) for f in shot.frames)}
    candidates = dict(_late(shot, pairs))
    if able:
        few = screened(pairs)
        best = min(able, key=lambda name: residuals(few, able[name].change).mean())
        candidates[best] = (able[best], [pair.motion_under(able[best].change) for pair in pairs])
    scores = {name: residuals_of(pairs, motions) for name, (_, motions) in candidates.items()}
    best = min(scores, key=lambda name: scores[name].mean())
    ((what, fix), motions), winner = candidates[best], scores[best]
    if winner.mean() > min(CLEARLY_BETTER * declared.mean(), LARGEST_MISMATCH) or not _wins(winner, declared):
        return []
    shown = SHOWN if shot.has_depth else CLEARLY_BETTER  # without depth the camera only seems to turn
    stood = residuals_of(pairs, [np.zeros_like(pair.own) for pair in pairs])
    if best in able and winner.mean() > shown * stood.mean():  # one that is late may stand
        return []
    if vectors_uphold(pairs, [pair.own - motion for pair, motion in zip(pairs, motions, strict=True)]):
        return []
    evidence = f"residual {winner.mean():.3f} against {declared.mean():.3f} as declared, over {len(pairs)} pairs"
    return [mistake(f"camera-{best}", what, evidence, sureness(declared, winner), fix)]


def screened(pairs: Sequence[Pair]) -> Sequence[Pair]:
    """Return about three of ``pairs``, enough to choose the best of many meanings."""
    return pairs[:: max(1, len(pairs) // 3)]


def residuals(pairs: Sequence[Pair], change: Change = lambda camera: camera) -> Vector:
    """Return the residual of each pair after ``change`` of its cameras."""
    return residuals_of(pairs, [pair.motion_under(change) for pair in pairs])


def residuals_of(pairs: Sequence[Pair], motions: Sequence[Vector]) -> Vector:
    """Return the residual of each pair under its motion, [2, n] pixels."""
    return np.array([camera_residual(pair, motion) for pair, motion in zip(pairs, motions, strict=True)])


ROUNDED_PX, ROUNDED = 2e-3, 1e-3  # rounding error of a vector, absolute and relative: twice the step of halves
UPHELD, FAR_FROM = 0.1, 10.0  # least share of the points; least factor by which another reading is worse there


def vectors_uphold(pairs: Sequence[Pair], others: Sequence[Vector], motions: Sequence[Vector] | None = None) -> bool:
    """Return True if vectors equal the motion of matrices and depth, or ``motions``, to rounding on a share of the
    picture, and differ far more from it, by ``others`` [2, n], under another reading.

    Such exact agreement is no chance: these points have no own motion, and pictures of things with own motion say
    nothing about the camera.
    """
    shares = []
    for pair, other, motion in zip(pairs, others, motions or [pair.camera_motion() for pair in pairs], strict=True):
        most = ROUNDED_PX + ROUNDED * np.hypot(*pair.own)
        agrees = np.hypot(*(pair.own - motion)) <= most
        shares.append((agrees & ~(np.hypot(*other) <= FAR_FROM * most)).mean())
    return float(np.mean(shares)) >= UPHELD


def _late(shot: Shot, pairs: Sequence[Pair]) -> Iterator[tuple[str, tuple[Meaning, list[Vector]]]]:
    cameras = {frame.index: frame.camera for frame in shot.frames}
    for delay, name in ((1, "late"), (-1, "early")):  # late first, to win a tie: writers usually lag
        motions = []
        for pair in pairs:
            later = delay * pair.frame.step
            now, before = cameras.get(pair.frame.index + later), cameras.get(pair.previous.index + later)
            # At the end of the sequence there is no such matrix; the declared one decides nothing.
            motions.append(pair.camera_motion(now, before) if now and before else pair.camera_motion())
        which = "next" if delay > 0 else "previous"
        meant = Meaning(f"each frame's true matrices are those of the {which} frame", {"delay": delay})
        yield name, (meant, motions)


def moving_pairs(shot: Shot) -> list[Pair]:
    """Return at most MOST_PAIRS pairs between which the camera moves."""
    pairs = [pair for pair in shot.pairs if not is_still(pair.frame.camera, pair.previous.camera)]
    return pairs[:: max(1, -(-len(pairs) // MOST_PAIRS))]


def _wins(winner: Vector, declared: Vector) -> bool:
    """Return True if the winner is better in most of the pairs in which the two differ."""
    differ = np.abs(winner - declared) > 0.01
    return bool(differ.any() and (winner < declared)[differ].mean() > 0.7)


def camera_residual(pair: Pair, motion: Vector) -> float:
    """Return the residual, 0 to 1, of the previous frame fetched by ``motion`` [2, n] and the best shift."""
    there = ~np.isfinite(pair.own).all(0) & pair.usable
    return _mismatch_at(pair, there if there.sum() >= LEAST_POINTS else pair.usable, motion)


MOST_VECTORS = 800  # vectors tested of a pair; few suffice, because each must agree by itself
LEAST_MOTION_PX = 0.02  # least median camera motion
APART_PX = 0.1  # least median difference that is reported
AGREE, DISAGREE = 0.1, 0.25  # median difference over median motion; a wrong jitter alone makes 0.05
ALIKE = 0.01  # smaller differences decide nothing: the plainer reading wins
SCALES = (1.0, 0.01, 100.0, 0.1, 10.0, 0.001, 1000.0)  # scales of depth
MOST_SEEN, SAME = 4000, 1.002  # most points compared of a pair; ratio of residuals that count as equal
LARGEST_SIZE = 20.0  # factor of vectors; units make greater ones


OCTAVES, HALVINGS = range(-10, 11), 14  # of a factor of depth, to 1e-4: a thousandth is rounding


class _Reading(NamedTuple):
    """One reading of matrices, depth and vectors; the difference of the two motions, and the camera's motion, in px."""

    camera: str
    scale: float
    vectors: str
    leak: float
    apart: float
    moved: float

    @property
    def changes(self) -> int:
        """Number of differences from the declaration."""
        words = len(COMBINED[self.camera].fix) + len(self.vectors.split())
        return words + (self.scale != 1.0) + (self.leak != 0.0)


def check_agreement(shot: Shot) -> list[Finding]:
    """Return findings about matrices, unit of depth and vectors that agree only under another reading."""
    pairs = _filled(shot)
    if len(pairs) < 2:
        return []
    maps = affine_maps(*shot.window, shot.unit) | _sized(pairs)
    leaks = [0, *shot.leaks.values()]
    as_declared = _vectors(pairs, {"": maps[""]}, leaks)
    declared = min(_compared(pairs, "", 1.0, as_declared), key=lambda reading: reading.apart)
    factor = _factor_of_depth(pairs)
    if factor == 1.0 and declared.apart < DISAGREE * max(declared.moved, LEAST_MOTION_PX):
        return []
    able = [name for name, meant in COMBINED.items() if all(sound(frame, meant.change) for frame in shot.frames)]
    vectors = _vectors(pairs, maps, leaks)
    tried = [
        reading for name in able for scale in {*SCALES, factor} for reading in _compared(pairs, name, scale, vectors)
    ]
    agreeing = [r for r in tried if r.moved > LEAST_MOTION_PX and r.apart < AGREE * r.moved]
    if not agreeing:
        return []
    nearest = min(reading.apart / reading.moved for reading in agreeing)
    alike = [reading for reading in agreeing if reading.apart / reading.moved < nearest + ALIKE]
    best = _seen(alike, moving_pairs(shot), maps)
    motions = [pair.motion_under(COMBINED[best.camera].change, best.scale) for pair in pairs]
    read = zip(vectors[best.vectors, best.leak], motions, strict=True)
    if vectors_uphold(pairs, [own - motion for own, motion in read]):
        return []
    return _findings(best, declared, maps, len(pairs))


def _factor_of_depth(pairs: Sequence[Pair]) -> float:
    """Return the factor of depth under which matrices and depth give the vectors, to rounding; 1 if none does."""

    def moved(factor: float) -> list[Vector]:
        return [pair.motion_under(lambda camera: camera, factor) for pair in pairs]

    def apart(factor: float) -> float:
        both = zip(pairs, moved(factor), strict=True)
        return float(np.mean([middle_length(pair.own - motion) for pair, motion in both]))

    factor = min((2.0**octave for octave in OCTAVES), key=apart)
    for halved in range(1, HALVINGS):
        by = 2.0**0.5**halved
        factor = min((factor, factor / by, factor * by), key=apart)
    differ = [pair.own - motion for pair, motion in zip(pairs, moved(1.0), strict=True)]
    return float(f"{factor:.4g}") if vectors_uphold(pairs, differ, moved(factor)) else 1.0


def _sized(pairs: Sequence[Pair]) -> dict[str, Affine]:
    """Return the factor, with each sign, that gives vectors the length of the declared camera's motion, by name."""
    lengths = [(middle_length(pair.camera_motion()), middle_length(pair.own)) for pair in pairs]
    factor = float(np.median([moved / max(own, ROUNDED_PX) for moved, own in lengths]))
    if not (1.0 / LARGEST_SIZE <= factor <= LARGEST_SIZE):
        return {}
    plain = whole(factor)
    factor = plain if abs(factor / plain - 1.0) < ALIKE else factor
    return {name: Affine(matrix) for name, matrix in (scaled(factor, sign) for sign in SIGNS) if factor != 1.0}


ZEROES = 0.5  # least share of zero vectors where the camera moves the picture, and of the frames with such vectors


def check_zeroes(shot: Shot) -> list[Finding]:
    """Find zero vectors where the camera moves the picture: they mean camera motion only, or were never written."""
    pairs = moving_pairs(shot) if shot.has_camera and shot.has_depth else []
    nothing = [(pair, np.asarray((pair.own == 0.0).all(0) & pair.usable & _moved(pair))) for pair in pairs]
    found = [(pair, points) for pair, points in nothing if points.sum() >= LEAST_POINTS]
    if len(found) < ZEROES * len(pairs) or not found:  # a single frame may lack its vectors, as the first of a shot
        return []
    able = [np.isfinite(pair.own).all(0) & pair.usable & _moved(pair) for pair, _ in found]
    share = float(np.mean([points.sum() / there.sum() for (_, points), there in zip(found, able, strict=True)]))
    if share < ZEROES:
        return []
    declared, winner = np.array(
        [[_mismatch_at(pair, points, motion) for motion in (pair.own, pair.camera_motion())] for pair, points in found]
    ).T
    moved = np.mean([middle_length(pair.camera_motion()[:, points]) for pair, points in found])
    sure = sureness(declared, winner)
    if moved > APART_PX:  # a question even against the pictures, and certain if all vectors are zero
        sure = max(sure, 0.9 if share == 1.0 else DOUBTFUL)
    evidence = f"{share:.0%} of the vectors are 0 where the camera moves by {moved:.2g} px; residual "
    evidence += f"{winner.mean():.3f} by matrices and depth, {declared.mean():.3f} as declared"
    what = "the motion vectors are 0 where the camera alone moves the picture"
    return [mistake("motion-zero-is-camera", what, evidence, sure, {"zero": "camera"})]


def _moved(pair: Pair) -> NDArray[np.bool_]:
    return np.asarray(np.hypot(*pair.camera_motion()) > LEAST_MOTION_PX)


def check_disagreement(shot: Shot) -> list[Finding]:
    """Find vectors that contradict matrices and depth on most of the picture and that the pixels do not support."""
    pairs = [pair for pair in shot.pairs if np.isfinite(pair.own).all(0).mean() >= COVERED]
    if not (pairs and shot.has_camera and shot.has_depth):
        return []
    pairs = pairs[:: max(1, -(-len(pairs) // MOST_PAIRS))]
    # The median over the pairs: with a delay the jitter of the last frame, and its part in the vectors, is unknown.
    apart = float(np.median([middle_length(pair.own - pair.camera_motion()) for pair in pairs]))
    moved = float(np.median([middle_length(pair.own) for pair in pairs]))
    if apart < max(DISAGREE * moved, APART_PX):
        return []
    there = [seen_before(pair, pair.own, pair.usable & np.isfinite(pair.own).all(0)) for pair in pairs]
    motions = [(pair.own, pair.camera_motion()) for pair in pairs]
    declared, winner = (
        np.array([_mismatch_at(pair, at, by[which]) for pair, at, by in zip(pairs, there, motions, strict=True)])
        for which in (0, 1)
    )
    if sureness(winner, declared) >= SURE:  # most of the picture has own motion
        return []
    sure = sureness(declared, winner) if winner.mean() < CLEARLY_BETTER * declared.mean() else DOUBTFUL
    if sure < SURE and not moving_pairs(shot):  # a moving belt may fill the picture
        return []
    evidence = f"they are {apart:.2g} px apart in the middle, of {moved:.2g}; residual {winner.mean():.3f} by matrices "
    evidence += f"and depth, {declared.mean():.3f} by the vectors"
    return [mistake("motion-disagrees", "the motion vectors are not those of matrices and depth", evidence, sure)]


def _mismatch_at(pair: Pair, points: NDArray[np.bool_], motion: Vector) -> float:
    """Return the residual at ``points`` of the previous frame fetched by ``motion`` [2, n] and the best shift."""
    chosen = np.flatnonzero(points)
    chosen = chosen[:: max(1, -(-len(chosen) // MOST_POINTS))]
    x, y = pair.x[chosen] + motion[0, chosen], pair.y[chosen] + motion[1, chosen]
    return fit_shift(pair.now[chosen], pair.before, x, y, pair.scale).residual


def check_late_vectors(shot: Shot) -> tuple[list[Finding], Shot]:
    """Find vectors that belong to the frame before: those of the frame after are what matrices and depth give, to
    rounding; also return the shot with these.

    Early matrices agree with them too where the camera only turns, so the pictures must match better in most pairs.
    """
    if not (shot.has_camera and shot.has_depth):
        return [], shot
    # All frames have one grid of points.
    both = [(one, replace(one, own=two.own)) for one, two in pairwise(shot.pairs) if two.previous is one.frame]
    moving = [(one, after) for one, after in both if not is_still(one.frame.camera, one.previous.camera)]
    apart = [one.declared_motion() - one.camera_motion() for one, _ in moving]
    late = [each for each, differ in zip(moving, apart, strict=True) if vectors_uphold(each[1:], [differ])]
    if len(late) < max(LEAST_LATE, len(moving) / 2):
        return [], shot
    declared, winner = np.array([[_vector_mismatch(pair, PLAIN, 0) for pair in each] for each in late]).T
    sure = sureness(np.sign(declared - winner), np.zeros(len(late)))
    if sure < SURE:
        return [], shot
    evidence = f"those of the frame after are the motion of matrices and depth, to rounding, in {len(late)} of "
    evidence += f"{counted(len(moving), 'pair')}, and the pictures match better by them in {(winner < declared).sum()}"
    what = "the motion vectors are those of the frame before: write each frame's into its own file"
    mended = copy(shot)
    mended.pairs, mended.shifts = [after for _, after in both], None
    return [mistake("motion-late", what, evidence, sure)], mended


def tells_map(shot: Shot, meant: Affine) -> bool:
    """Return True if vectors agree with matrices and depth, and would disagree if they were mapped by ``meant``."""
    pairs = _filled(shot)
    if len(pairs) < 2:
        return False
    both = (_vectors(pairs, {"": each}, [0, *shot.leaks.values()]) for each in (PLAIN, meant))
    right, wrong = (min(reading.apart for reading in _compared(pairs, "", 1.0, vectors)) for vectors in both)
    moved = float(np.mean([middle_length(pair.camera_motion()) for pair in pairs]))
    return right < AGREE * moved and wrong >= DISAGREE * max(moved, LEAST_MOTION_PX)


def _filled(shot: Shot) -> list[Pair]:
    """Return pairs with a moving camera and vectors that fill the picture, reduced to a few of their points."""
    pairs = [_sparse(pair) for pair in moving_pairs(shot)] if shot.has_camera and shot.has_depth else []
    pairs = [pair for pair in pairs if len(pair.x) >= LEAST_POINTS and np.isfinite(pair.own).all(0).mean() >= COVERED]
    # A projection alone changes by a zoom, or by jitter left in it.
    return [p for p in pairs if not np.array_equal(p.frame.camera.world_to_view, p.previous.camera.world_to_view)]


def _seen(alike: Sequence[_Reading], pairs: Sequence[Pair], maps: dict[str, Affine]) -> _Reading:
    """Return the plainest of the agreeing readings whose vectors match the pictures best.

    The pictures must decide: to first order, inverse matrices and vectors to the next frame agree as well as the right
    ones.
    """
    mismatch = {
        kind: float(np.mean([_vector_mismatch(pair, maps[kind[0]], kind[1]) for pair in pairs]))
        for kind in {(reading.vectors, reading.leak) for reading in alike}
    }
    most = SAME * min(mismatch.values())
    return min((r for r in alike if mismatch[r.vectors, r.leak] <= most), key=lambda reading: reading.changes)


def _vector_mismatch(pair: Pair, meant: Affine, leak: float) -> float:
    """Return the residual of the previous frame fetched by the vectors: by the declared jitter plus by any shift."""
    there = np.flatnonzero(np.isfinite(pair.own).all(0) & pair.usable)
    there = there[:: max(1, -(-len(there) // MOST_SEEN))]
    u, v = meant(pair.own[:, there]) - leak * pair.jitter_change[:, None]
    x, y, now = pair.x[there] + u, pair.y[there] + v, pair.now[there]
    right, down = pair.jitter_change
    declared = residual_of(now, pair.before, x + right, y + down, pair.scale)
    return declared + fit_shift(now, pair.before, x, y, pair.scale).residual


def _sparse(pair: Pair) -> Pair:
    """Reduce ``pair`` to a few of its points, with depth if possible: the sky does not depend on its unit."""
    chosen = np.flatnonzero(pair.inverse_depth != sky_inverse_depth(pair.frame.camera))
    if len(chosen) < LEAST_POINTS:
        chosen = np.arange(len(pair.x))
    return pair.at(chosen[:: max(1, len(chosen) // MOST_VECTORS)])


Vectors = dict[tuple[str, float], list[Vector]]  # (name of a map, leak) -> vectors [2, n] of each pair


def _vectors(pairs: Sequence[Pair], maps: dict[str, Affine], leaks: Sequence[int]) -> Vectors:
    """Return the vectors under each of ``maps``, less each of ``leaks``, factors of the change of jitter."""
    return {
        (name, leak): [meant(pair.own) - leak * pair.jitter_change[:, None] for pair in pairs]
        for name, meant in maps.items()
        for leak in leaks
    }


def _compared(pairs: Sequence[Pair], camera: str, scale: float, vectors: Vectors) -> Iterator[_Reading]:
    """Yield a reading for each of ``vectors``, compared with the camera's motion under one reading of the matrices."""
    motions = [pair.motion_under(COMBINED[camera].change, scale) for pair in pairs]
    moved = float(np.mean([middle_length(motion) for motion in motions]))
    for (name, leak), of_pairs in vectors.items():
        apart = [middle_length(own - motion) for own, motion in zip(of_pairs, motions, strict=True)]
        yield _Reading(camera, scale, name, leak, float(np.mean(apart)), moved)


def middle_length(vectors: Vector) -> float:
    """Return the median length of the finite ``vectors`` [2, n]; infinite if there are none."""
    lengths = np.hypot(*vectors)
    known = lengths[np.isfinite(lengths)]
    return float(np.median(known)) if known.size else np.inf


def _findings(best: _Reading, declared: _Reading, maps: dict[str, Affine], pairs: int) -> list[Finding]:
    evidence = f"matrices and vectors of {pairs} pairs agree so, to {best.apart:.2g} px of {best.moved:.2g}, "
    evidence += f"as declared only to {declared.apart:.2g}"
    confidence = float(np.clip(1.0 - best.apart / best.moved, 0.3, 0.99))
    made: list[tuple[str, str, Mapping[str, object]]] = []
    if best.camera:
        meant = COMBINED[best.camera]
        made.append((f"camera-{best.camera}", meant.what, meant.fix))
    if best.scale != 1.0:
        what = f"depth and matrices have different units: depth times {best.scale:g} fits"
        made.append(("depth-scaled", what, {"scale": best.scale}))
    if best.vectors:
        what = f"the motion vectors are {spoken(best.vectors)}"
        made.append((f"motion-{best.vectors}", what, maps[best.vectors].fix))
    return [mistake(name, what, evidence, confidence, fix) for name, what, fix in made]


def check_upside_down(shot: Shot) -> list[Finding]:
    """Find a projection that flips y, as Vulkan's does, if the camera's motion is the same either way.

    A right-handed view with such a projection draws the world mirrored. That is right only for a picture whose rows go
    up, which the check accepts if vectors that fill the picture, or the pixels, support it.
    """
    name, clip = "y-flipped", shot.frames[0].camera.view_to_clip
    if not (shot.has_camera and clip[0, 0] > 0.0 > clip[1, 1]):
        return []
    change, pairs = MEANINGS[name].change, moving_pairs(shot)
    turned = [pair.motion_under(change) for pair in pairs]
    if pairs and all(_borne_out(pair, motion) for pair, motion in zip(pairs, turned, strict=True)):
        return []  # the check of the vectors would find flipped ones
    if pairs and residuals(pairs).mean() < CLEARLY_BETTER * residuals(pairs, change).mean():
        return []
    what, fix = MEANINGS[name]
    evidence = f"it scales y by {clip[1, 1]:.3g} and x by {clip[0, 0]:.3g}: the world would be seen mirrored"
    return [mistake(f"camera-{name}", what, evidence, 0.9, fix)]


def _borne_out(pair: Pair, turned: Vector) -> bool:
    """Return True if vectors fill the picture and equal the declared camera's motion, not the ``turned`` one [2, n]."""
    if np.isfinite(pair.own).all(0).mean() < COVERED:
        return False
    return middle_length(pair.own - pair.camera_motion()) < DISAGREE * middle_length(pair.own - turned)
