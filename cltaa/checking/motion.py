"""Whether the motion channel means what its reader takes it for: sign, axes, units, scale, offset, jitter.

Each hypothesis is a linear map of the declared vectors. It is judged by how well the previous frame, fetched through
it, matches this one; the least residual wins if it wins clearly. The camera's part (points without a vector) tells
how far jitter alone moved the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cltaa.checking.alignment import LEAST_POINTS, Fit, fit_shift, residual_of
from cltaa.checking.finding import Finding
from cltaa.checking.gains import linear_maps, regress
from cltaa.checking.shots import Pair, Shot
from cltaa.checking.signal import Vector, sample

CLEARLY_BETTER = 0.92  # residual of the winner over that of the declaration
LEAST_MOTION_PX = 0.02  # median length below which a vector says nothing
LEAST_LEAK = 0.5  # of the change of jitter


class _Scene(NamedTuple):
    """Points of one pair that carry a vector, and the shift that jitter gave the picture (None: not known)."""

    pair: Pair
    own: Vector  # [2, n]
    x: Vector
    y: Vector
    now: Vector
    shift: Vector | None


def check_motion(shot: Shot, shifts: Sequence[Fit | None], anchored: bool) -> list[Finding]:
    """Findings about the motion channel; ``shifts`` were measured without it where ``anchored``."""
    scenes = _scenes(shot, shifts, anchored)
    if not scenes:
        return []
    lengths = np.concatenate([np.hypot(*scene.own) for scene in scenes])
    if not lengths.any():
        return []
    width, height = shot.frames[0].width, shot.frames[0].height
    maps = linear_maps(width, height)
    offsets = {name: np.zeros(2) for name in maps}
    for name, unit in (("centred-on-half uv", (width, height)), ("centred-on-half ndc", (width, -height))):
        maps[name], offsets[name] = np.diag(np.array(unit, float)), np.array([0.5, 0.5])
    scores = {name: _score(scenes, maps[name], offsets[name]) for name in maps}
    best = min(scores, key=lambda name: scores[name].mean())
    declared, winner = scores[""], scores[best]
    if best and winner.mean() < CLEARLY_BETTER * declared.mean() and (winner < declared).mean() > 0.7:
        return [_named(best, maps[best], offsets[best], declared, winner)]
    return _leak(shot, scenes, anchored)


def _scenes(shot: Shot, shifts: Sequence[Fit | None], anchored: bool) -> list[_Scene]:
    scenes = []
    for pair, fit in zip(shot.pairs, shifts, strict=True):
        there = np.isfinite(pair.own).all(0) & pair.usable
        if there.sum() < LEAST_POINTS:
            continue
        shift = fit.shift if anchored and fit is not None else None
        scenes.append(_Scene(pair, pair.own[:, there], pair.x[there], pair.y[there], pair.now[there], shift))
    return scenes


def _score(scenes: Sequence[_Scene], matrix: Vector, offset: Vector) -> Vector:
    """Residual of each pair under vectors = matrix @ (declared - offset)."""
    residuals = []
    for scene in scenes:
        u, v = matrix @ (scene.own - offset[:, None])
        x, y, pair = scene.x + u, scene.y + v, scene.pair
        if scene.shift is None:
            residuals.append(fit_shift(scene.now, pair.before, x, y, pair.scale).residual)
        else:
            x, y = x + scene.shift[0], y + scene.shift[1]
            residuals.append(residual_of(scene.now, pair.before, x, y, pair.scale))
    return np.array(residuals)


def _named(best: str, matrix: Vector, offset: Vector, declared: Vector, winner: Vector) -> Finding:
    swap = bool(matrix[0, 0] == 0.0)
    scale = [float(matrix[0, 1]), float(matrix[1, 0])] if swap else [float(matrix[0, 0]), float(matrix[1, 1])]
    fix: dict[str, object] = {"scale": scale}
    if swap:
        fix["swap"] = True
    if offset.any():
        fix["offset"] = offset.tolist()
    wins = int((winner < declared).sum())
    return Finding(
        name="motion-" + best.replace(" ", "-"), mistake=True,
        confidence=float(np.clip(1.0 - (winner.mean() / declared.mean()) ** 2, 0.3, 0.99)),
        what=f"the motion vectors are {best.replace('-', ' ')}",
        evidence=f"residual {winner.mean():.3f} against {declared.mean():.3f} as declared, better in {wins} of "
        f"{len(declared)} pairs",
        fix={"motion": fix},
    )  # fmt: skip


def _leak(shot: Shot, scenes: Sequence[_Scene], anchored: bool) -> list[Finding]:
    """Jitter left in the vectors: what still pixels declare, or what the vectors leave over, follows the jitter."""
    change = np.array([scene.pair.jitter_change for scene in scenes])
    if len(scenes) < 4 or not change.any():
        return []
    left = np.array([_resting(scene) for scene in scenes]) if not anchored else -_left_over(scenes)
    fit = regress(left, change, np.ones(len(left)))
    gain = float(np.trace(fit.matrix)) / 2.0
    spread = float(np.sqrt((change**2).sum(1).mean()))
    if abs(gain) < LEAST_LEAK or fit.left > 0.5 * spread:
        return []
    sign = "" if gain > 0 else "-reversed"
    return [
        Finding(
            name=f"motion-jittered{sign}", mistake=True,
            confidence=float(np.clip(1.0 - fit.left / spread, 0.3, 0.99)),
            what="the motion vectors contain the change of jitter",
            evidence=f"they follow {gain:.2f} x the change of jitter over {len(scenes)} pairs, {fit.left:.2f} px rms left",
            fix={"motion": {"jittered": 1 if gain > 0 else -1}},
        )
    ]  # fmt: skip


def _resting(scene: _Scene) -> Vector:
    """What the vectors say beyond the camera's motion where that is least: the middle of the smallest quarter."""
    beyond = scene.own - scene.pair.camera_motion()[:, np.isfinite(scene.pair.own).all(0) & scene.pair.usable]
    middle = np.nanmedian(beyond, axis=1)
    near = np.hypot(*(beyond - middle[:, None]))
    return np.asarray(np.nanmedian(beyond[:, near <= np.nanquantile(near, 0.5)], axis=1))


def _left_over(scenes: Sequence[_Scene]) -> Vector:
    """Shift [n, 2] that is left between the pictures after the vectors and the shift of the still part."""
    left = []
    for scene in scenes:
        assert scene.shift is not None
        x, y = scene.x + scene.own[0] + scene.shift[0], scene.y + scene.own[1] + scene.shift[1]
        inside = np.isfinite(sample(scene.pair.before.signal, x, y))
        left.append(fit_shift(scene.now[inside], scene.pair.before, x[inside], y[inside], scene.pair.scale).shift)
    return np.array(left)
