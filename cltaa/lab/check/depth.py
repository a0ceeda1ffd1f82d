"""Find the kind of depth in the depth channel.

A rasteriser draws planes, and on a plane 1/Z is a linear function of the pixel (docs/conventions.md, Matrices). So the
second differences of inverse depth vanish under the right reading of the channel, in any scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.frame import Camera, Frame, Image
from cltaa.inputs.convert import device_planes, planar_depth, planes_of, ray_length
from cltaa.inputs.profile import Depth, DepthKind
from cltaa.lab.check.camera import (
    CLEARLY_BETTER,
    LARGEST_MISMATCH,
    camera_residual,
    moving_pairs,
    residuals_of,
    screened,
    vectors_uphold,
)
from cltaa.lab.check.hypotheses import DOUBTFUL, Finding, mistake, sureness
from cltaa.lab.check.registration import Pair, Shot, Vector, planar_inverse_depth, seen_before

Plane = NDArray[np.float64]

ROUNDING = 16  # tolerance in rounding steps: second difference of three numbers, doubled for the rasteriser
FINEST, COARSE = 2.0**-23, 2.0**-11.5  # step of float32; the least of halves is 2^-11
COARSEST = 2.0**-8  # the greatest step of halves is 2^-10, and some halves may not occur
MOSTLY = 0.9  # share of negative depths, above which the sign is wrong
CLEARLY_MORE = 0.8  # share of the pixels that distinguish two readings
LEAST_PIXELS = 200
MOST_FRAMES = 3  # all frames have the same kind of depth; more only cost time
DEVICE = "depth is a device depth, 0 near to 1 far"
REVERSED = "depth is a reversed device depth, 1 near to 0 far"
RECIPROCAL = "depth is 1/Z, or a reversed device depth"
AS_DECLARED = Depth()
READ_AS = {DepthKind.PLANAR: "planar", DepthKind.RAY: "ray"}  # all other kinds are linear on a plane, like 1/Z
ALONG = {"planar": "the view axis, not along the ray", "ray": "the ray, not along the view axis"}
SCALES = (0.001, 0.01, 0.1, 0.2, 0.5, 2.0, 5.0, 10.0, 100.0, 1000.0)  # tried first; the best is then refined
STEPS = (2.0**0.5, 2.0**0.25, 2.0**0.125, 2.0**0.0625)  # refinement up and down, to about 4 %
ROUND_NUMBER = 0.1  # a scale this near to a power of ten becomes one


def check_depth(frames: Sequence[Frame], rule: Depth = AS_DECLARED) -> list[Finding]:
    """Return findings about the kind and direction of depth, from single frames that were read by ``rule``.

    Judges the stored numbers, independent of the reading: the declared kind is one hypothesis among others.
    """
    frames = frames[:MOST_FRAMES]
    depth = [stored(frame, frame.depth.astype(np.float64), rule) for frame in frames]
    finite = _finite(depth)
    if not len(finite):
        return []
    if negative := check_sign(depth):
        return negative
    read = READ_AS.get(rule.kind, "reciprocal")
    shares = {kind: share for kind, share in _flat_shares(frames, depth, read).items() if share > CLEARLY_MORE}
    for kind in sorted(shares, key=lambda kind: -shares[kind])[:1]:
        evidence = f"of the pixels that tell, {shares[kind]:.1%} lie on planes as {kind} and "
        evidence += f"{1.0 - shares[kind]:.1%} as {read} depth"
        if kind == "reciprocal":
            return [_reciprocal(depth, finite, evidence, shares[kind])]
        what = f"depth is the distance along {ALONG[kind]}"
        return [mistake(f"depth-{kind}", what, evidence, shares[kind], {"kind": kind})]
    # Planes cannot decide for values close below 1: all of 1/Z lies within a few rounding steps.
    if read == "planar" and finite.min() >= 0.0 and finite.max() <= 1.0 and np.median(finite) > 0.9:
        evidence = f"all values within {finite.min():.4g} and {finite.max():.4g}, their middle {np.median(finite):.4g}"
        return [mistake("depth-device", DEVICE, evidence, 0.85, {"kind": "device"})]
    return []


def check_sign(depth: Sequence[Plane | Image]) -> list[Finding]:
    """Find depth that is negative nearly everywhere, which needs no matrices."""
    finite = _finite(depth)
    negative = float((finite < 0).mean()) if len(finite) else 0.0
    if negative <= MOSTLY:
        return []
    evidence, what = f"{negative:.0%} of the depths are negative", "depth is negative in front of the camera"
    return [mistake("depth-negative", what, evidence, 0.99, {"scale": -1.0})]


def _finite(depth: Sequence[Plane | Image]) -> Vector:
    return np.concatenate([plane[np.isfinite(plane)].astype(np.float64) for plane in depth])


def stored(frame: Frame, planar: Plane, rule: Depth) -> Plane:
    """Return the stored numbers, up to their scale, of depth that was read by ``rule``."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if rule.kind is DepthKind.RAY:
            return planar * ray_length(planar.shape, frame.camera, frame.jitter_px)
        if rule.kind is DepthKind.INVERSE:
            return np.asarray(1.0 / planar, np.float64)
        if rule.kind in (DepthKind.DEVICE, DepthKind.DEVICE_REVERSED):
            near, far = device_planes(rule, frame.camera)
            at_near = (rule.scale / planar - far) / (near - far)
            return np.asarray(at_near if rule.kind is DepthKind.DEVICE_REVERSED else 1.0 - at_near, np.float64)
    return planar


def other_readings(rule: Depth, camera: Camera) -> list[Depth]:
    """Return ``rule`` with each other kind, near/Z if the projection has a near plane.

    Not with device depth that grows with distance: it reads small numbers as one plane, which fits any motion along it,
    and check_depth knows its own numbers, all close to 1.
    """
    kinds = [DepthKind.PLANAR, DepthKind.RAY, DepthKind.INVERSE]
    near, far = device_planes(rule, camera)
    kinds += [DepthKind.DEVICE_REVERSED] if near > 0.0 and (near, far) != (1.0, 0.0) else []  # 1/Z itself
    return [msgspec.structs.replace(rule, kind=kind) for kind in kinds if kind != rule.kind]


def inverse_as(frame: Frame, rule: Depth, read: Depth) -> Plane:
    """Return the inverse depth [H, W] of a frame read by ``rule``, if it were read by ``read``; 0 where unknown."""
    plain = msgspec.structs.replace(rule, scale=1.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        raw: Image = stored(frame, frame.depth.astype(np.float64) / rule.scale, plain).astype(np.float32)
        return planar_inverse_depth(planar_depth(raw, read, frame.camera, frame.jitter_px), frame.camera)


def check_depth_scale(shot: Shot, rule: Depth = AS_DECLARED) -> list[Finding]:
    """Find depth in other units than the matrices, by the parallax of a moving camera."""
    pairs = moving_pairs(shot)
    if len(pairs) < 2 or not (shot.has_depth and shot.has_camera) or shot.frames[0].camera.orthographic:
        return []
    few = screened(pairs)
    best = min(SCALES, key=lambda scale: _gain(_scaled(few, scale)))
    declared, winner = found = _scaled(pairs, best)
    if winner.mean() > min(CLEARLY_BETTER * declared.mean(), LARGEST_MISMATCH) or (winner < declared).mean() < 0.7:
        return []
    if vectors_uphold(pairs, [pair.own - pair.motion_under(lambda camera: camera, best) for pair in pairs]):
        return []
    for step in STEPS:
        tried = [(best * by, _scaled(pairs, best * by)) for by in (1 / step, step)]
        best, found = min([(best, found), *tried], key=lambda one: _gain(one[1]))
    declared, winner = found
    if not planes_decide(shot.frames, rule) and _fits_as_another(pairs, rule, winner):
        return []
    decade = 10.0 ** round(np.log10(best))
    scale = decade if abs(best / decade - 1) < ROUND_NUMBER else float(f"{best:.2g}")
    evidence = f"residual {winner.mean():.3f} against {declared.mean():.3f} as declared, over {len(pairs)} pairs"
    what = f"depth and matrices have different units: depth times {scale:g} fits"
    sure = sureness(declared, winner)
    around = [_scaled(pairs, scale * by)[1].mean() for by in (2.0, 0.5)]
    if scale != decade and min(around) < winner.mean() / CLEARLY_BETTER:
        evidence, sure = f"{evidence}; so do others", min(sure, DOUBTFUL)
    return [mistake("depth-scaled", what, evidence, sure, {"scale": scale})]


def _fits_as_another(pairs: Sequence[Pair], rule: Depth, winner: Vector) -> bool:
    """Return True if depth of another kind fits as well as the scaled one: a wrong jitter may hide the kind."""
    for read in other_readings(rule, pairs[0].frame.camera):
        motions = []
        for pair in pairs:
            inverse = inverse_as(pair.frame, rule, read)[pair.y.astype(int), pair.x.astype(int)]
            motions.append(pair.camera_motion(inverse_depth=inverse))
        both = zip(pairs, motions, strict=True)
        seen = [replace(pair, usable=seen_before(pair, motion, pair.usable)) for pair, motion in both]
        if residuals_of(seen, motions).mean() <= winner.mean():
            return True
    return False


def _scaled(pairs: Sequence[Pair], scale: float) -> tuple[Vector, Vector]:
    """Return residuals of ``pairs`` as declared and with depth scaled, at points that both keep in the picture.

    Otherwise the columns that the faster motion moves out of a small picture would outweigh the difference of the two.
    """
    found = []
    for pair in pairs:
        own, scaled = pair.camera_motion(), pair.motion_under(lambda camera: camera, scale)
        there = replace(pair, usable=seen_before(pair, scaled, seen_before(pair, own, pair.usable)))
        found.append((camera_residual(there, own), camera_residual(there, scaled)))
    declared, changed = np.array(found).T
    return declared, changed


def _gain(found: tuple[Vector, Vector]) -> float:
    declared, changed = found
    return float(changed.mean() - declared.mean())


def tells_kind(frames: Sequence[Frame]) -> bool:
    """Return True if tilted planes are in view, on which 1/Z and Z differ."""
    frames = frames[:MOST_FRAMES]
    return "reciprocal" in _flat_shares(frames, [frame.depth.astype(np.float64) for frame in frames], "planar")


def planes_decide(frames: Sequence[Frame], rule: Depth) -> bool:
    """Return True if planes in view confirm the kind of depth, read by ``rule``, against every other."""
    frames, read = frames[:MOST_FRAMES], READ_AS.get(rule.kind, "reciprocal")
    depth = [stored(frame, frame.depth.astype(np.float64), rule) for frame in frames]
    shares = _flat_shares(frames, depth, read)
    return len(shares) == len(READ_AS) and max(shares.values()) < 1.0 - CLEARLY_MORE  # one for each other reading


def is_coarse(frames: Sequence[Frame]) -> bool:
    """Return True for depth that was stored in half precision; False for a few distances far apart."""
    steps = [_step(frame.depth[_known(frame.depth)].astype(np.float64)) for frame in frames[:MOST_FRAMES]]
    return any(FINEST < step <= COARSEST for step in steps)


def _known(depth: Plane | NDArray[np.float32]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(depth) & (depth > 0) & (depth < 1e9))


def _flat_shares(frames: Sequence[Frame], depth: Sequence[Plane], read: str) -> dict[str, float]:
    """Return for each reading the share of pixels on planes, among the pixels where it and ``read`` disagree."""
    flat: dict[str, list[NDArray[np.bool_]]] = {"planar": [], "ray": [], "reciprocal": []}
    for frame, raw in zip(frames, depth, strict=True):
        usable = _known(raw)
        step = _step(raw[usable])
        for kind, inverse_depth in _readings(frame, np.where(usable, raw, np.nan)).items():
            # Along rows and columns, because a level floor has one depth along each row.
            flat[kind] += [_are_flat(lines, step) for lines in (inverse_depth, inverse_depth.T)]
    table = {kind: np.concatenate(planes) for kind, planes in flat.items()}
    shares = {}
    for kind in table:
        telling = table[kind] != table[read]
        if telling.sum() >= LEAST_PIXELS:
            shares[kind] = float(table[kind][telling].mean())
    return shares


def _readings(frame: Frame, raw: Plane) -> dict[str, Plane]:
    """Return the value that is linear on a plane if ``raw`` is planar depth, distance along the ray, or reciprocal."""
    near = 1.0 / raw
    if frame.camera.orthographic:
        return {"planar": raw, "ray": raw, "reciprocal": near}
    return {"planar": near, "ray": near * ray_length(raw.shape, frame.camera, frame.jitter_px), "reciprocal": raw}


def _step(values: Vector) -> float:
    """Return the largest relative rounding step of the numbers: float32, or half if they were stored so."""
    distinct = np.unique(values)
    least = float((np.diff(distinct) / distinct[1:]).min()) if len(distinct) > 1 else 0.0
    return 2.0 * least if least > COARSE else FINEST


def _are_flat(lines: Plane, step: float) -> NDArray[np.bool_]:
    """Return for each three known neighbours of a row whether they are collinear, to rounding."""
    left, middle, right = lines[:, :-2], lines[:, 1:-1], lines[:, 2:]
    with np.errstate(invalid="ignore"):
        flat = np.abs(left - 2 * middle + right) <= ROUNDING * step * np.abs(middle)
    return np.asarray(flat[np.isfinite(left + middle + right)])


def _reciprocal(planes: Sequence[Plane], finite: Vector, evidence: str, confidence: float) -> Finding:
    """Distinguish 1/Z from device depth and find its direction, by the range, the sky and the lower rows."""
    bounded = finite.max() <= 1.0 and finite.min() >= 0.0
    sky_at_one, sky_at_zero = float((finite == 1.0).mean()), float((finite == 0.0).mean())
    depth = np.stack(planes)
    rows = depth.shape[1]
    lower, upper = (_middle(part) for part in (depth[:, -(-rows * 5 // 6) :], depth[:, : rows // 2]))
    nearer_is_smaller = sky_at_one > sky_at_zero if max(sky_at_one, sky_at_zero) > 0.01 else bool(lower < upper)
    evidence += f"; values {finite.min():.4g} to {finite.max():.4g}"
    if bounded and nearer_is_smaller:
        return mistake("depth-device", DEVICE, evidence, confidence, {"kind": "device"})
    return mistake("depth-inverse", RECIPROCAL, evidence, confidence, {"kind": "inverse"})


def _middle(values: Plane) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else np.inf


def tell_device(shot: Shot, found: Finding, rule: Depth) -> Finding:
    """Distinguish reversed device depth (near / Z) from 1/Z, and find the near plane of device depth.

    No device depth exceeds 1. The two differ by a factor, which the parallax of a moving camera shows; for device depth
    it is 2, because clip space begins at -1 or at 0. A projection that falls with distance decides, unless 1/Z matches
    clearly better.
    """
    clip = shot.frames[0].camera.view_to_clip
    reverse = found.name == "depth-inverse"
    planes = [stored(frame, frame.depth.astype(np.float64), rule) for frame in shot.frames[:MOST_FRAMES]]
    if reverse and _finite(planes).max() > 1.0:
        return found
    falls = reverse and clip[2, 3] > 0.0 and not shot.frames[0].camera.orthographic
    as_projected = _reversed(found, "the projection is reversed too") if falls else found
    pairs = moving_pairs(shot)
    near, other = (planes_of(clip, from_zero=from_zero)[0] for from_zero in (False, True))
    if len(pairs) < 2 or near <= 0.0 or (reverse and near == 1.0):
        return as_projected
    planes = [stored(pair.frame, pair.frame.depth.astype(np.float64), rule) for pair in pairs]
    raw = [plane[pair.y.astype(int), pair.x.astype(int)] for plane, pair in zip(planes, pairs, strict=True)]
    near_to_far = raw if reverse else [1.0 - values for values in raw]
    by_plain, by_changed = (
        [pair.camera_motion(inverse_depth=values * by) for pair, values in zip(pairs, near_to_far, strict=True)]
        for by in ((1.0, near) if reverse else (near, other))
    )
    both = zip(pairs, by_plain, strict=True)
    pairs = [replace(pair, usable=seen_before(pair, motion, pair.usable)) for pair, motion in both]
    plain, changed = (residuals_of(pairs, motions) for motions in (by_plain, by_changed))
    by_vectors = [
        vectors_uphold(pairs, [pair.own - motion for pair, motion in zip(pairs, other, strict=True)], motions)
        for motions, other in ((by_plain, by_changed), (by_changed, by_plain))
    ]
    if falls and not by_vectors[0]:
        # Wrong matrices match worse the nearer all is, and least badly where it is far away.
        away = [
            pair.camera_motion(inverse_depth=np.zeros_like(values)) for pair, values in zip(pairs, raw, strict=True)
        ]
        if plain.mean() > CLEARLY_BETTER * min(changed.mean(), residuals_of(pairs, away).mean()):
            return as_projected
    if by_vectors[0] or (changed.mean() >= plain.mean() and not by_vectors[1]):
        return found
    seen = "the vectors agree so, " if by_vectors[1] else ""
    if reverse:
        return _reversed(found, f"{seen}residual {changed.mean():.3f} as near / Z, {plain.mean():.3f} as 1/Z")
    evidence = f"{found.evidence}; {seen}residual {changed.mean():.3f} with a clip space from 0, "
    evidence += f"{plain.mean():.3f} from -1"
    return mistake(
        found.name, found.what, evidence, found.confidence, {"kind": "device", "near": float(f"{1.0 / other:.6g}")}
    )


def _reversed(found: Finding, evidence: str) -> Finding:
    evidence = f"{found.evidence}; {evidence}"
    return mistake("depth-device-reversed", REVERSED, evidence, found.confidence, {"kind": "device-reversed"})
