"""Which kind of depth the depth channel holds.

A rasteriser draws planes, and over a plane 1/Z is a linear function of the pixel (docs/conventions.md, Matrices). So
the right reading of the channel is the one under which the second differences of closeness vanish, whatever is shown.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cltaa.checking.finding import Finding
from cltaa.checking.shots import Shot
from cltaa.checking.signal import Vector
from cltaa.checking.travel import CLEARLY_BETTER, _moves, _residual
from cltaa.frames import Camera, Frame

Plane = NDArray[np.float64]

ROUNDING = 16 * 2.0**-23  # second difference of three float32 numbers, with as much again for the rasteriser
LEAST_FLAT = 0.2  # of the pixels that tell the readings apart
LEAST_PIXELS = 200
SCALES = {"0.01": 0.01, "0.1": 0.1, "10": 10.0, "100": 100.0, "1000": 1000.0, "0.001": 0.001}


def check_depth(frames: Sequence[Frame]) -> list[Finding]:
    """Findings about the kind and direction of depth, from single frames."""
    depth = [frame.depth.astype(np.float64) for frame in frames]
    finite = np.concatenate([plane[np.isfinite(plane)] for plane in depth])
    if not len(finite):
        return []
    if (finite < 0).mean() > 0.9:
        evidence = f"{(finite < 0).mean():.0%} of the depths are negative"
        what = "depth is negative in front of the camera"
        return [_finding("depth-negative", what, evidence, 0.99, {"scale": -1.0})]
    shares = _flat_shares(frames, depth)
    best = max(shares, key=lambda kind: shares[kind])
    if best == "planar" or shares[best] < LEAST_FLAT or shares[best] < 2.0 * shares["planar"]:
        return []
    evidence = "share of pixels on planes: " + ", ".join(f"{share:.2f} as {kind}" for kind, share in shares.items())
    confidence = float(min(0.99, shares[best] / (shares[best] + shares["planar"] + 0.01)))
    if best == "ray":
        what = "depth is the distance along the ray, not along the view axis"
        return [_finding("depth-ray", what, evidence, confidence, {"kind": "ray"})]
    return [_reciprocal(frames, finite, evidence, confidence)]


def check_depth_scale(shot: Shot) -> list[Finding]:
    """Find depth in other units than the matrices, by the parallax of a camera that travels."""
    pairs = [pair for pair in shot.pairs if _moves(pair)]
    if len(pairs) < 2 or not (shot.has_depth and shot.has_camera) or shot.frames[0].camera.orthographic:
        return []
    declared = np.array([_residual(pair, pair.camera_motion()) for pair in pairs])
    scores = {
        name: np.array([_residual(pair, pair.camera_motion(closeness=pair.closeness / scale)) for pair in pairs])
        for name, scale in SCALES.items()
    }
    best = min(scores, key=lambda name: scores[name].mean())
    winner = scores[best]
    if winner.mean() > CLEARLY_BETTER * declared.mean() or (winner < declared).mean() < 0.7:
        return []
    evidence = f"residual {winner.mean():.3f} against {declared.mean():.3f} as declared, over {len(pairs)} pairs"
    confidence = float(np.clip(1.0 - (winner.mean() / declared.mean()) ** 2, 0.3, 0.99))
    what = f"depth and matrices have different units: depth times {best} fits"
    return [_finding("depth-scaled", what, evidence, confidence, {"scale": SCALES[best]})]


def _flat_shares(frames: Sequence[Frame], depth: Sequence[Plane]) -> dict[str, float]:
    """Share of pixels on planes under each reading, among those on which the readings differ."""
    flat: dict[str, list[NDArray[np.bool_]]] = {"planar": [], "ray": [], "reciprocal": []}
    valid = []
    for frame, raw in zip(frames, depth, strict=True):
        if frame.camera.orthographic:
            readings = {"planar": raw, "ray": np.full_like(raw, np.nan)}
            with np.errstate(divide="ignore", invalid="ignore"):
                readings["reciprocal"] = np.where(raw > 0, 1.0 / raw, np.nan)
        else:
            with np.errstate(divide="ignore", invalid="ignore"):
                near = np.where(raw > 0, 1.0 / raw, np.nan)
            readings = {"planar": near, "ray": near * _ray_length(frame), "reciprocal": raw}
        usable = np.isfinite(raw) & (raw > 0) & (raw < 1e9)
        triple = usable[:, :-2] & usable[:, 1:-1] & usable[:, 2:]
        valid.append(triple)
        for kind, closeness in readings.items():
            flat[kind].append(_is_flat(closeness))
    inside = np.concatenate([plane.ravel() for plane in valid])
    table = {kind: np.concatenate([plane.ravel() for plane in planes])[inside] for kind, planes in flat.items()}
    telling = ~np.logical_and.reduce(list(table.values()))
    if telling.sum() < LEAST_PIXELS:
        return {"planar": 1.0, "ray": 0.0, "reciprocal": 0.0}
    return {kind: float(plane[telling].mean()) for kind, plane in table.items()}


def _is_flat(closeness: Plane) -> NDArray[np.bool_]:
    """True where three neighbours of a row lie on a line, to rounding."""
    left, middle, right = closeness[:, :-2], closeness[:, 1:-1], closeness[:, 2:]
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(left - 2 * middle + right) <= ROUNDING * np.abs(middle))


def _ray_length(frame: Frame) -> Plane:
    """Length of the ray to each sample for a planar distance of 1, [H, W]."""
    y, x = np.mgrid[: frame.height, : frame.width].astype(np.float64)
    n_x = (x + 0.5 + frame.jitter_px[0]) / frame.width * 2 - 1
    n_y = 1 - (y + 0.5 + frame.jitter_px[1]) / frame.height * 2
    clip = frame.camera.view_to_clip
    across = np.linalg.inv(clip[:2, :2])
    ray = np.tensordot(across, np.stack([n_x + clip[0, 2], n_y + clip[1, 2]]), 1)
    return np.asarray(np.sqrt(1.0 + ray[0] ** 2 + ray[1] ** 2))


def _reciprocal(frames: Sequence[Frame], finite: Vector, evidence: str, confidence: float) -> Finding:
    """Tell 1/Z from device depth, and its direction, by range and by what the sky and the lower rows hold."""
    bounded = finite.max() <= 1.0 and finite.min() >= 0.0
    sky_at_one, sky_at_zero = float((finite == 1.0).mean()), float((finite == 0.0).mean())
    depth = np.stack([frame.depth for frame in frames])
    lower = np.median(depth[:, -depth.shape[1] // 6 :])
    upper = np.median(depth[:, : depth.shape[1] // 2])
    nearer_is_smaller = sky_at_one > sky_at_zero if max(sky_at_one, sky_at_zero) > 0.01 else bool(lower < upper)
    evidence += f"; values {finite.min():.4g} to {finite.max():.4g}"
    if bounded and nearer_is_smaller:
        return _finding("depth-device", "depth is a device depth, 0 near to 1 far", evidence, confidence,
                        {"kind": "device"})  # fmt: skip
    if bounded and _has_near(frames[0].camera):
        return _finding("depth-device-reversed", "depth is a reversed device depth, 1 near to 0 far (or 1/Z)", evidence,
                        confidence, {"kind": "device-reversed"})  # fmt: skip
    return _finding("depth-inverse", "depth is 1/Z", evidence, confidence, {"kind": "inverse"})


def _has_near(camera: Camera) -> bool:
    return not camera.orthographic and bool(camera.view_to_clip[2, 3] != 0.0)


def _finding(name: str, what: str, evidence: str, confidence: float, fix: dict[str, object]) -> Finding:
    return Finding(
        name=name, mistake=True, confidence=confidence, what=what, evidence=evidence, fix={"depth": fix}
    )  # fmt: skip
