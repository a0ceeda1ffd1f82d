"""Whether cameras' matrices mean what their reader takes them for: transposed, inverted, flipped, late.

Where an engine writes both, most pixels rest in the world, and there the two must be one. Read wrongly they are one
under no other reading but the right one: tens of thousands of numbers agree with others or do not, which slow motion
and coarse samples cannot hide as they hide how well pictures match.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
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
    SURE,
    Affine,
    Change,
    Finding,
    Meaning,
    affine_maps,
    mistake,
    spoken,
    sureness,
)
from cltaa.lab.check.registration import COVERED, LEAST_POINTS, Pair, Shot, Vector, fit_shift, residual_of, seen_before

MOST_PAIRS, MOST_POINTS = 6, 3000  # looked at for each of a dozen meanings; more only cost time
LARGEST_MISMATCH = 0.5  # residual of a meaning that is named
CLEARLY_BETTER = 0.85  # residual of the winner over that of the declaration


def sound(frame: Frame, change: Change | None = None) -> bool:
    """True when the camera of a frame, changed so, is one that can be used."""
    try:
        check_camera(frame.camera if change is None else change(frame.camera))
    except (DataError, np.linalg.LinAlgError):
        return False
    return True


def check_structure(frames: Sequence[Frame]) -> tuple[list[Finding], Change | None]:
    """Findings about matrices that cannot be cameras, and what makes them ones (None: nothing does, or is needed)."""
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
    """How badly frames match under other matrices; 0 where the camera stands, and any of them do."""
    size = frames[0].width, frames[0].height  # no vectors are looked at
    shot = Shot([replace(frame, camera=change(frame.camera)) for frame in frames], size)
    pairs = moving_pairs(shot)
    return float(residuals(pairs).mean()) if pairs else 0.0


def check_travel(shot: Shot) -> list[Finding]:
    """Judge other meanings of the matrices by how well the previous frame, fetched through them, matches this one."""
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
    if vectors_uphold(pairs, [pair.own - motion for pair, motion in zip(pairs, motions, strict=True)]):
        return []
    evidence = f"residual {winner.mean():.3f} against {declared.mean():.3f} as declared, over {len(pairs)} pairs"
    return [mistake(f"camera-{best}", what, evidence, sureness(declared, winner), fix)]


def screened(pairs: Sequence[Pair]) -> Sequence[Pair]:
    """About three of ``pairs``, by which the best of many meanings is chosen."""
    return pairs[:: max(1, len(pairs) // 3)]


def residuals(pairs: Sequence[Pair], change: Change = lambda camera: camera) -> Vector:
    """How badly each pair matches with its cameras changed so."""
    return residuals_of(pairs, [pair.motion_under(change) for pair in pairs])


def residuals_of(pairs: Sequence[Pair], motions: Sequence[Vector]) -> Vector:
    """How badly each pair matches by its motion, [2, n] pixels."""
    return np.array([camera_residual(pair, motion) for pair, motion in zip(pairs, motions, strict=True)])


ROUNDED_PX, ROUNDED = 2e-3, 1e-3  # what rounding leaves of a vector, and of its length: twice the step of halves
UPHELD, FAR_FROM = 0.1, 10.0  # share of the points; how much more another reading leaves there


def vectors_uphold(pairs: Sequence[Pair], others: Sequence[Vector], motions: Sequence[Vector] | None = None) -> bool:
    """True where vectors are those of matrices and depth, or ``motions``, on a good share of the picture, but for
    rounding, and far from it under another reading, by which they would be ``others`` [2, n] apart.

    So exact they are by no chance: these points rest, and of what moves on its own the pictures tell no camera.
    """
    shares = []
    for pair, other, motion in zip(pairs, others, motions or [pair.camera_motion() for pair in pairs], strict=True):
        most = ROUNDED_PX + ROUNDED * np.hypot(*pair.own)
        agrees = np.hypot(*(pair.own - motion)) <= most
        shares.append((agrees & ~(np.hypot(*other) <= FAR_FROM * most)).mean())
    return float(np.mean(shares)) >= UPHELD


def _late(shot: Shot, pairs: Sequence[Pair]) -> Iterator[tuple[str, tuple[Meaning, list[Vector]]]]:
    cameras = {frame.index: frame.camera for frame in shot.frames}
    for delay, name in ((1, "late"), (-1, "early")):  # of two that fit alike the first is taken: writers lag
        motions = []
        for pair in pairs:
            later = delay * pair.frame.step
            now, before = cameras.get(pair.frame.index + later), cameras.get(pair.previous.index + later)
            # At the end of the sequence there is no such matrix: neither better nor worse than declared.
            motions.append(pair.camera_motion(now, before) if now and before else pair.camera_motion())
        which = "next" if delay > 0 else "previous"
        meant = Meaning(f"each frame's true matrices are those of the {which} frame", {"delay": delay})
        yield name, (meant, motions)


def moving_pairs(shot: Shot) -> list[Pair]:
    """At most MOST_PAIRS pairs between which the camera moves."""
    pairs = [pair for pair in shot.pairs if not is_still(pair.frame.camera, pair.previous.camera)]
    return pairs[:: max(1, -(-len(pairs) // MOST_PAIRS))]


def _wins(winner: Vector, declared: Vector) -> bool:
    """True when most pairs in which the two differ agree."""
    differ = np.abs(winner - declared) > 0.01
    return bool(differ.any() and (winner < declared)[differ].mean() > 0.7)


def camera_residual(pair: Pair, motion: Vector) -> float:
    """How badly the previous frame, fetched through ``motion`` [2, n] and the best shift, matches; 0 to 1."""
    there = ~np.isfinite(pair.own).all(0) & pair.usable
    return _mismatch_at(pair, there if there.sum() >= LEAST_POINTS else pair.usable, motion)


MOST_VECTORS = 800  # of a pair: each must agree by itself
LEAST_MOTION_PX = 0.02  # of the camera, in the middle of the picture's points
APART_PX = 0.1  # middle difference that is worth a word
AGREE, DISAGREE = 0.1, 0.25  # middle difference over middle motion; a wrong jitter alone makes 0.05
ALIKE = 0.01  # differences nearer than that decide nothing: the plainer reading is taken
SCALES = (1.0, 0.01, 100.0, 0.1, 10.0, 0.001, 1000.0)  # of depth
MOST_SEEN, SAME = 4000, 1.002  # points of a pair whose picture is looked at; mismatches nearer than that are alike
LEAKS = (0.0, 1.0, -1.0)  # of the change of jitter, in the vectors


class _Reading(NamedTuple):
    """One reading of matrices, depth and vectors, how far the two then differ, and how fast the camera then moves."""

    camera: str
    scale: float
    vectors: str
    leak: float
    apart: float
    moved: float

    @property
    def changes(self) -> int:
        """In how many ways it differs from what was declared."""
        words = len(COMBINED[self.camera].fix) + len(self.vectors.split())
        return words + (self.scale != 1.0) + (self.leak != 0.0)


def check_agreement(shot: Shot) -> list[Finding]:
    """Findings about matrices, unit of depth and vectors, where only another reading makes them agree."""
    pairs = _filled(shot)
    if len(pairs) < 2:
        return []
    maps = affine_maps(*shot.window)
    declared = min(_compared(pairs, "", 1.0, _vectors(pairs, {"": maps[""]})), key=lambda reading: reading.apart)
    if declared.apart < DISAGREE * max(declared.moved, LEAST_MOTION_PX):
        return []
    able = [name for name, meant in COMBINED.items() if all(sound(frame, meant.change) for frame in shot.frames)]
    vectors = _vectors(pairs, maps)
    tried = [reading for name in able for scale in SCALES for reading in _compared(pairs, name, scale, vectors)]
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


ZEROES = 0.5  # share of the vectors that are nothing where the camera moves the picture


def check_zeroes(shot: Shot) -> list[Finding]:
    """Find vectors of nothing where the camera moves what rests: it alone is meant, or nothing was written."""
    pairs = moving_pairs(shot) if shot.has_camera and shot.has_depth else []
    nothing = [(pair, np.asarray((pair.own == 0.0).all(0) & pair.usable & _moved(pair))) for pair in pairs]
    found = [(pair, points) for pair, points in nothing if points.sum() >= LEAST_POINTS]
    if not found:
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
    if moved > APART_PX:  # whatever the pictures show: asked, and certain where nothing was written
        sure = max(sure, 0.9 if share == 1.0 else DOUBTFUL)
    evidence = f"{share:.0%} of the vectors are 0 where the camera moves by {moved:.2g} px; residual "
    evidence += f"{winner.mean():.3f} by matrices and depth, {declared.mean():.3f} as declared"
    what = "the motion vectors are 0 where the camera alone moves the picture"
    return [mistake("motion-zero-is-camera", what, evidence, sure, {"zero": "camera"})]


def _moved(pair: Pair) -> NDArray[np.bool_]:
    return np.asarray(np.hypot(*pair.camera_motion()) > LEAST_MOTION_PX)


def check_disagreement(shot: Shot) -> list[Finding]:
    """Find vectors that are not what matrices and depth say of most of the picture, where no pixels bear them out."""
    pairs = [pair for pair in shot.pairs if np.isfinite(pair.own).all(0).mean() >= COVERED]
    if not (pairs and shot.has_camera and shot.has_depth):
        return []
    pairs = pairs[:: max(1, -(-len(pairs) // MOST_PAIRS))]
    # The middle one: of a delay the jitter of a frame at the end is not known, nor what it left in vectors.
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
    if sureness(winner, declared) >= SURE:  # most of the picture moves by itself
        return []
    sure = sureness(declared, winner) if winner.mean() < CLEARLY_BETTER * declared.mean() else DOUBTFUL
    if sure < SURE and not moving_pairs(shot):  # as of a belt that fills the picture
        return []
    evidence = (
        f"they are {apart:.2g} px apart in the middle, of {moved:.2g}; residual {winner.mean():.3f} by matrices and "
    )
    evidence += f"depth, {declared.mean():.3f} by the vectors"
    return [mistake("motion-disagrees", "the motion vectors are not those of matrices and depth", evidence, sure)]


def _mismatch_at(pair: Pair, points: NDArray[np.bool_], motion: Vector) -> float:
    """How badly the previous frame, fetched through ``motion`` [2, n] and the best shift, matches at ``points``."""
    chosen = np.flatnonzero(points)
    chosen = chosen[:: max(1, -(-len(chosen) // MOST_POINTS))]
    x, y = pair.x[chosen] + motion[0, chosen], pair.y[chosen] + motion[1, chosen]
    return fit_shift(pair.now[chosen], pair.before, x, y, pair.scale).residual


def tells_map(shot: Shot, meant: Affine) -> bool:
    """True where vectors that agree with matrices and depth, under ``meant`` alone, would be told apart from it."""
    pairs, plain = _filled(shot), Affine(np.eye(2))
    if len(pairs) < 2:
        return False
    both = (_vectors(pairs, {"": each}) for each in (plain, meant))
    right, wrong = (min(reading.apart for reading in _compared(pairs, "", 1.0, vectors)) for vectors in both)
    moved = float(np.mean([middle_length(pair.camera_motion()) for pair in pairs]))
    return right < AGREE * moved and wrong >= DISAGREE * max(moved, LEAST_MOTION_PX)


def _filled(shot: Shot) -> list[Pair]:
    """Pairs between which the camera moves and whose vectors fill the picture, at a few of their points."""
    pairs = [_sparse(pair) for pair in moving_pairs(shot)] if shot.has_camera and shot.has_depth else []
    pairs = [pair for pair in pairs if len(pair.x) >= LEAST_POINTS and np.isfinite(pair.own).all(0).mean() >= COVERED]
    # A projection alone changes by a zoom, or by the jitter that was left in it.
    return [p for p in pairs if not np.array_equal(p.frame.camera.world_to_view, p.previous.camera.world_to_view)]


def _seen(alike: Sequence[_Reading], pairs: Sequence[Pair], maps: dict[str, Affine]) -> _Reading:
    """The plainest of readings that agree, of those of the vectors that agree best with the pictures.

    Inverse matrices and vectors to the frame after agree as well as the right ones do, to the first order.
    """
    mismatch = {
        kind: float(np.mean([_vector_mismatch(pair, maps[kind[0]], kind[1]) for pair in pairs]))
        for kind in {(reading.vectors, reading.leak) for reading in alike}
    }
    most = SAME * min(mismatch.values())
    return min((r for r in alike if mismatch[r.vectors, r.leak] <= most), key=lambda reading: reading.changes)


def _vector_mismatch(pair: Pair, meant: Affine, leak: float) -> float:
    """How badly the previous frame, fetched through the vectors, matches: by the declared jitter and by any shift."""
    there = np.flatnonzero(np.isfinite(pair.own).all(0) & pair.usable)
    there = there[:: max(1, -(-len(there) // MOST_SEEN))]
    u, v = meant(pair.own[:, there]) - leak * pair.jitter_change[:, None]
    x, y, now = pair.x[there] + u, pair.y[there] + v, pair.now[there]
    right, down = pair.jitter_change
    declared = residual_of(now, pair.before, x + right, y + down, pair.scale)
    return declared + fit_shift(now, pair.before, x, y, pair.scale).residual


def _sparse(pair: Pair) -> Pair:
    """``pair`` at a few of its points, such as have a depth: the sky says nothing of its unit."""
    chosen = np.flatnonzero(pair.inverse_depth != sky_inverse_depth(pair.frame.camera))
    if len(chosen) < LEAST_POINTS:
        chosen = np.arange(len(pair.x))
    chosen = chosen[:: max(1, len(chosen) // MOST_VECTORS)]
    return replace(
        pair,
        x=pair.x[chosen],
        y=pair.y[chosen],
        now=pair.now[chosen],
        inverse_depth=pair.inverse_depth[chosen],
        own=pair.own[:, chosen],
        lit=pair.lit[chosen],
        usable=pair.usable[chosen],
    )


Vectors = dict[tuple[str, float], list[Vector]]  # those of each pair [2, n], by the name of a map and a leak


def _vectors(pairs: Sequence[Pair], maps: dict[str, Affine]) -> Vectors:
    """The vectors under each of ``maps``, without each of LEAKS."""
    return {
        (name, leak): [meant(pair.own) - leak * pair.jitter_change[:, None] for pair in pairs]
        for name, meant in maps.items()
        for leak in LEAKS
    }


def _compared(pairs: Sequence[Pair], camera: str, scale: float, vectors: Vectors) -> Iterator[_Reading]:
    """How far each of ``vectors`` are from the camera's motion under one reading of that."""
    motions = [pair.motion_under(COMBINED[camera].change, scale) for pair in pairs]
    moved = float(np.mean([middle_length(motion) for motion in motions]))
    for (name, leak), of_pairs in vectors.items():
        apart = [middle_length(own - motion) for own, motion in zip(of_pairs, motions, strict=True)]
        yield _Reading(camera, scale, name, leak, float(np.mean(apart)), moved)


def middle_length(vectors: Vector) -> float:
    """The middle length of those of ``vectors`` [2, n] that are numbers; infinite where there is none."""
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
    """Find a projection that turns the picture over, as Vulkan's does, where the camera moves the same either way.

    A right-handed view and such a projection draw the world mirrored. Only a picture whose rows go up is right so; that
    is believed where the vectors that fill it, or the pixels, bear it out.
    """
    name, clip = "y-flipped", shot.frames[0].camera.view_to_clip
    if not (shot.has_camera and clip[0, 0] > 0.0 > clip[1, 1]):
        return []
    change, pairs = MEANINGS[name].change, moving_pairs(shot)
    turned = [pair.motion_under(change) for pair in pairs]
    if pairs and all(_borne_out(pair, motion) for pair, motion in zip(pairs, turned, strict=True)):
        return []  # were the vectors turned over too, the check of these would say so
    if pairs and residuals(pairs).mean() < CLEARLY_BETTER * residuals(pairs, change).mean():
        return []
    what, fix = MEANINGS[name]
    evidence = f"it scales y by {clip[1, 1]:.3g} and x by {clip[0, 0]:.3g}: the world would be seen mirrored"
    return [mistake(f"camera-{name}", what, evidence, 0.9, fix)]


def _borne_out(pair: Pair, turned: Vector) -> bool:
    """True where vectors fill the picture that are the declared camera's motion, and not the ``turned`` one [2, n]."""
    if np.isfinite(pair.own).all(0).mean() < COVERED:
        return False
    return middle_length(pair.own - pair.camera_motion()) < DISAGREE * middle_length(pair.own - turned)
