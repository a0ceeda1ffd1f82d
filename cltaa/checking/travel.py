"""Whether the cameras' matrices mean what their reader takes them for: transposed, inverted, flipped, late."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from cltaa.cameras import is_still
from cltaa.checking.alignment import LEAST_POINTS, fit_shift
from cltaa.checking.finding import Finding
from cltaa.checking.gains import regress
from cltaa.checking.meanings import MEANINGS, Change
from cltaa.checking.shots import Pair, Shot
from cltaa.checking.signal import Vector
from cltaa.errors import DataError
from cltaa.frame_checks import check_camera
from cltaa.frames import Camera, Frame

MOST_PAIRS, MOST_POINTS = 6, 8000  # looked at for each of a dozen meanings; more only cost time
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
        evidence = f"last rows {row} and {clip} as read, of a camera only when {name.replace('-', ' ')}"
        if alike:
            evidence += f"; or {', '.join(alike)}, under which the pictures match about as well"
        confidence = 0.95 / (1 + len(alike))
        finding = Finding(
            name=f"camera-{name}", mistake=True, confidence=confidence, what=what, evidence=evidence,
            fix={"camera": fix},
        )  # fmt: skip
        return [finding], MEANINGS[name].change
    evidence = f"frame {wrong[0].index}: neither as read nor transposed, inverted or flipped"
    what = "the matrices are no camera"
    return [Finding(name="camera-wrong", mistake=True, confidence=0.95, what=what, evidence=evidence)], None


def _mismatch(frames: Sequence[Frame], change: Change) -> float:
    """How badly frames match under other matrices; 0 where the camera stands, and any of them do."""
    size = frames[0].width, frames[0].height  # no vectors are looked at
    shot = Shot([replace(frame, camera=change(frame.camera)) for frame in frames], size)
    return float(np.mean([camera_residual(pair, pair.camera_motion()) for pair in moving_pairs(shot)] or [0.0]))


def check_projection_jitter(shot: Shot) -> list[Finding]:
    """Find jitter that was left in the projection: its centre follows the declared jitter, frame by frame."""
    sizes = np.array([shot.frames[0].width, shot.frames[0].height], float)
    centre = np.array([_centre(frame.camera) for frame in shot.frames]) * sizes * (0.5, -0.5)
    jitter = np.array([frame.jitter_px for frame in shot.frames])
    centre, jitter = centre - centre.mean(0), jitter - jitter.mean(0)
    if len(shot.frames) < 3 or not jitter.any() or np.abs(centre).max() < 1e-4:
        return []
    fit = regress(centre, jitter, np.ones(len(jitter)))
    across, down = np.diag(fit.matrix).tolist()
    if max(abs(abs(across) - 1.0), abs(abs(down) - 1.0)) > 0.1 or fit.left > 0.05:
        return []
    evidence = f"its centre moves by {across:.3f}, {down:.3f} x the declared jitter, to {fit.left:.1g} px"
    name, fix = "jittered", {"jittered": True}
    what = "the projection contains the jitter"
    if across * down < 0.0:  # what is left of the two is found when it is read so
        if shot.frames[0].camera.view_to_clip[1, 1] > 0.0:
            return []
        name, (what, fix) = "y-flipped", MEANINGS["y-flipped"]
    return [
        Finding(
            name=f"camera-{name}", mistake=True, confidence=0.98, what=what, evidence=evidence, fix={"camera": fix}
        )
    ]  # fmt: skip


def check_travel(shot: Shot) -> list[Finding]:
    """Judge other meanings of the matrices by how well the previous frame, fetched through them, matches this one."""
    pairs = moving_pairs(shot)
    if len(pairs) < 2 or not shot.has_camera:
        return []
    declared = np.array([camera_residual(pair, pair.camera_motion()) for pair in pairs])
    candidates: dict[str, tuple[str, dict[str, object], Vector]] = {}
    for name, meant in MEANINGS.items():
        change = meant.change
        if all(sound(frame, change) for frame in shot.frames):
            scores = [
                camera_residual(pair, pair.camera_motion(change(pair.frame.camera), change(pair.previous.camera)))
                for pair in pairs
            ]
            candidates[name] = (meant.what, meant.fix, np.array(scores))
    candidates |= dict(_late(shot, pairs))
    if not candidates:
        return []
    best = min(candidates, key=lambda name: candidates[name][2].mean())
    what, fix, winner = candidates[best]
    if winner.mean() > CLEARLY_BETTER * declared.mean() or not _wins(winner, declared):
        return []
    evidence = f"residual {winner.mean():.3f} against {declared.mean():.3f} as declared, over {len(pairs)} pairs"
    confidence = float(np.clip(1.0 - (winner.mean() / declared.mean()) ** 2, 0.3, 0.99))
    return [
        Finding(
            name=f"camera-{best}", mistake=True, confidence=confidence, what=what, evidence=evidence,
            fix={"camera": fix},
        )
    ]  # fmt: skip


def _late(shot: Shot, pairs: Sequence[Pair]) -> Iterator[tuple[str, tuple[str, dict[str, object], Vector]]]:
    cameras = {frame.index: frame.camera for frame in shot.frames}
    for delay, name in ((1, "late"), (-1, "early")):  # of two that fit alike the first is taken: writers lag
        scores = []
        for pair in pairs:
            later = delay * pair.frame.step
            now, before = cameras.get(pair.frame.index + later), cameras.get(pair.previous.index + later)
            # At the end of the sequence there is no such matrix: neither better nor worse than declared.
            scores.append(
                camera_residual(pair, pair.camera_motion(now, before) if now and before else pair.camera_motion())
            )
        which = "next" if delay > 0 else "previous"
        yield name, (f"each frame's true matrices are those of the {which} frame", {"delay": delay}, np.array(scores))


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
    if there.sum() < LEAST_POINTS:
        there = pair.usable
    chosen = np.flatnonzero(there)[:: max(1, -(-int(there.sum()) // MOST_POINTS))]
    x, y = pair.x[chosen] + motion[0, chosen], pair.y[chosen] + motion[1, chosen]
    return fit_shift(pair.now[chosen], pair.before, x, y, pair.scale).residual


def _centre(camera: Camera) -> Vector:
    """Where the projection puts the viewing axis in NDC, [2]."""
    column = 3 if camera.orthographic else 2
    sign = 1.0 if camera.orthographic else -1.0
    return sign * camera.view_to_clip[:2, column]
