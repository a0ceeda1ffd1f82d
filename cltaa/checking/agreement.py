"""Vectors that cover the picture, held against what matrices and depth say of the same pixels.

Where an engine writes both, most pixels rest in the world, and there the two must be one. Read wrongly they are one
under no other reading but the right one: tens of thousands of numbers agree with others or do not, which slow motion
and coarse samples cannot hide as they hide how well pictures match.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cltaa.cameras import sky_closeness
from cltaa.checking.alignment import LEAST_POINTS, fit_shift, residual_of
from cltaa.checking.finding import Finding
from cltaa.checking.gains import Affine, affine_maps, spoken
from cltaa.checking.meanings import COMBINED
from cltaa.checking.shots import COVERED, Pair, Shot
from cltaa.checking.signal import Vector
from cltaa.checking.travel import moving_pairs, sound

MOST_POINTS = 800  # of a pair: each must agree by itself
LEAST_MOTION_PX = 0.02  # of the camera, in the middle of the picture's points
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
    declared = min(_compared(pairs, "", 1.0, {"": maps[""]}), key=lambda reading: reading.apart)
    if declared.apart < DISAGREE * max(declared.moved, LEAST_MOTION_PX):
        return []
    able = [name for name, meant in COMBINED.items() if all(sound(frame, meant.change) for frame in shot.frames)]
    tried = [reading for name in able for scale in SCALES for reading in _compared(pairs, name, scale, maps)]
    agreeing = [r for r in tried if r.moved > LEAST_MOTION_PX and r.apart < AGREE * r.moved]
    if not agreeing:
        return []
    nearest = min(reading.apart / reading.moved for reading in agreeing)
    alike = [reading for reading in agreeing if reading.apart / reading.moved < nearest + ALIKE]
    return _findings(_seen(alike, moving_pairs(shot), maps), declared, maps, len(pairs))


def tells_map(shot: Shot, meant: Affine) -> bool:
    """True where vectors that agree with matrices and depth, under ``meant`` alone, would be told apart from it."""
    pairs, plain = _filled(shot), Affine(np.eye(2))
    if len(pairs) < 2:
        return False
    right, wrong = (min(reading.apart for reading in _compared(pairs, "", 1.0, {"": map_})) for map_ in (plain, meant))
    moved = float(np.mean([middle_length(pair.camera_motion()) for pair in pairs]))
    return right < AGREE * moved and wrong >= DISAGREE * max(moved, LEAST_MOTION_PX)


def _filled(shot: Shot) -> list[Pair]:
    """Pairs between which the camera moves and whose vectors fill the picture, at a few of their points."""
    pairs = [_sparse(pair) for pair in moving_pairs(shot)] if shot.has_camera and shot.has_depth else []
    pairs = [pair for pair in pairs if len(pair.x) >= LEAST_POINTS and np.isfinite(pair.own).all(0).mean() >= COVERED]
    # A projection alone changes by a zoom, or by the jitter that was left in it.
    return [p for p in pairs if not np.array_equal(p.frame.camera.world_to_view, p.previous.camera.world_to_view)]


def _seen(alike: Sequence[_Reading], pairs: Sequence[Pair], maps: dict[str, Affine]) -> _Reading:
    """The plainest of readings that agree, of those of the vectors that the pictures bear out best.

    Inverse matrices and vectors to the frame after agree as well as the right ones do, to the first order.
    """
    mismatch = {
        kind: float(np.mean([_mismatch(pair, maps[kind[0]], kind[1]) for pair in pairs]))
        for kind in {(reading.vectors, reading.leak) for reading in alike}
    }
    most = SAME * min(mismatch.values())
    return min((r for r in alike if mismatch[r.vectors, r.leak] <= most), key=lambda reading: reading.changes)


def _mismatch(pair: Pair, meant: Affine, leak: float) -> float:
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
    chosen = np.flatnonzero(pair.closeness != sky_closeness(pair.frame.camera))
    if len(chosen) < LEAST_POINTS:
        chosen = np.arange(len(pair.x))
    chosen = chosen[:: max(1, len(chosen) // MOST_POINTS)]
    return replace(
        pair, x=pair.x[chosen], y=pair.y[chosen], now=pair.now[chosen], closeness=pair.closeness[chosen],
        own=pair.own[:, chosen], usable=pair.usable[chosen],
    )  # fmt: skip


def _compared(pairs: Sequence[Pair], camera: str, scale: float, maps: dict[str, Affine]) -> Iterator[_Reading]:
    """How far vectors under each of ``maps`` are from the camera's motion under one reading of that."""
    change = COMBINED[camera].change
    motions = [
        pair.camera_motion(change(pair.frame.camera), change(pair.previous.camera), pair.closeness / scale)
        for pair in pairs
    ]
    moved = float(np.mean([middle_length(motion) for motion in motions]))
    for name, meant in maps.items():
        vectors = [meant(pair.own) for pair in pairs]
        for leak in LEAKS:
            apart = [
                middle_length(own - leak * pair.jitter_change[:, None] - motion)
                for pair, own, motion in zip(pairs, vectors, motions, strict=True)
            ]
            yield _Reading(camera, scale, name, leak, float(np.mean(apart)), moved)


def middle_length(vectors: Vector) -> float:
    """The middle length of those of ``vectors`` [2, n] that are numbers; infinite where there is none."""
    known = vectors[:, np.isfinite(vectors).all(0)]
    return float(np.median(np.hypot(*known))) if known.size else np.inf


def _findings(best: _Reading, declared: _Reading, maps: dict[str, Affine], pairs: int) -> list[Finding]:
    evidence = f"matrices and vectors of {pairs} pairs agree so, to {best.apart:.2g} px of {best.moved:.2g}, "
    evidence += f"as declared only to {declared.apart:.2g}"
    confidence = float(np.clip(1.0 - best.apart / best.moved, 0.3, 0.99))
    made = []
    if best.camera:
        meant = COMBINED[best.camera]
        made.append((f"camera-{best.camera}", meant.what, {"camera": meant.fix}))
    if best.scale != 1.0:
        what = f"depth and matrices have different units: depth times {best.scale:g} fits"
        made.append(("depth-scaled", what, {"depth": {"scale": best.scale}}))
    if best.vectors:
        what = f"the motion vectors are {spoken(best.vectors)}"
        made.append((f"motion-{best.vectors.replace(' ', '-')}", what, {"motion": maps[best.vectors].fix}))
    return [
        Finding(name=name, mistake=True, confidence=confidence, what=what, evidence=evidence, fix=fix)
        for name, what, fix in made
    ]
