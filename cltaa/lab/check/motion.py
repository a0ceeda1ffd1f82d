"""Check whether motion vectors follow the declared conventions: sign, axes, units, scale, offset, jitter.

Each hypothesis is a linear map of the declared vectors. Its residual is the mismatch of this frame and the previous one
fetched by the mapped vectors; the least residual must win clearly. Points without a vector, moved by the camera only,
show how far jitter alone moved the picture.

For errors smaller than the width of an edge these residuals differ too little. A fit of a model to the gradient of all
points resolves a hundredth of a pixel: displacement = G m + d + L c, with m the declared vectors, d the measured shift
of the still part, and c the change of jitter. For right vectors G is the identity and L is zero.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from cltaa.lab.check.camera import ROUNDED, ROUNDED_PX, UPHELD
from cltaa.lab.check.hypotheses import (
    DOUBTFUL,
    NEAR,
    PLAIN,
    SIGNS,
    Affine,
    Finding,
    affine_maps,
    left_over,
    linear_fix,
    linear_maps,
    mistake,
    regress,
    scaled,
    simple,
    spoken,
    sureness,
    to_and_fro,
    whole,
)
from cltaa.lab.check.registration import (
    BLOCK,
    COVERED,
    FARTHEST_PX,
    LEAST_POINTS,
    Fit,
    Mask,
    Pair,
    Picture,
    Shifts,
    Shot,
    Vector,
    differences,
    find_shift,
    linearised,
    seen_before,
    stays_inside,
)

ITERATIONS = 15
TIE = 1e-3  # of the mean information: unknowns that the pixels do not determine stay as declared


class Observed(NamedTuple):
    """Points of one pair that carry a vector; ``shift`` is None if no still part shows the shift by jitter."""

    own: Vector  # [2, n]
    x: Vector
    y: Vector
    now: Vector
    before: Picture
    scale: float
    shift: Vector | None
    jitter_change: Vector  # [2]


class Model(NamedTuple):
    """G [2, 2], L [2, 2] and the information matrix [8, 8] of both, flattened row by row."""

    gain: Vector
    leak: Vector
    information: Vector

    def distance(self, gain: Vector, leak: Vector) -> float:
        """Return how much worse another gain and leak explain the pixels."""
        step = np.concatenate([(gain - self.gain).ravel(), (leak - self.leak).ravel()])
        return float(step @ self.information @ step)


def fit_model(observed: Sequence[Observed]) -> Model:
    """Fit the model to all pairs at once, from the identity, by Gauss-Newton with robust weights."""
    unknown = np.concatenate([np.eye(2).ravel(), np.zeros(4)])
    start = unknown.copy()
    information = np.zeros((8, 8))
    for _ in range(ITERATIONS):
        information, gradient = np.zeros((8, 8)), np.zeros(8)
        for pair in observed:
            part, towards = _normal_equations(pair, unknown)
            information += part
            gradient += towards
        tie = TIE * np.trace(information) / 8 * np.eye(8) + 1e-12 * np.eye(8)
        step = np.linalg.solve(information + tie, gradient - tie @ (unknown - start))
        unknown = unknown + np.clip(step, -0.5, 0.5)
        if np.abs(step).max() < 1e-3:
            break
    return Model(unknown[:4].reshape(2, 2), unknown[4:].reshape(2, 2), information)


def explanations(model: Model, maps: Mapping[str, Vector], leaks: Mapping[str, int]) -> dict[str, float]:
    """Return the distance of the model from each of ``maps`` of the vectors, and from each of ``leaks`` of the change
    of jitter into them, by name."""
    none, one = np.zeros((2, 2)), np.eye(2)
    distances = {name: model.distance(matrix, none) for name, matrix in maps.items()}
    # Vectors m' = m + c need c subtracted.
    return distances | {name: model.distance(one, -leak * one) for name, leak in leaks.items()}


def _normal_equations(pair: Observed, unknown: Vector) -> tuple[Vector, Vector]:
    gain, leak = unknown[:4].reshape(2, 2), unknown[4:].reshape(2, 2)
    shift = np.zeros(2) if pair.shift is None else pair.shift
    u, v = gain @ pair.own + (shift + leak @ pair.jitter_change)[:, None]
    left, (by_x, by_y), weight, inside = linearised(pair.now, pair.before, pair.x + u, pair.y + v, pair.scale)
    change = np.repeat(pair.jitter_change[:, None], len(left), axis=1)
    slope = np.concatenate([by_x * pair.own[:, inside], by_y * pair.own[:, inside], by_x * change, by_y * change])
    return (slope * weight) @ slope.T, (slope * weight) @ left


CLEARLY_BETTER, BETTER = 0.8, 0.93  # residual of the winner over that as declared
FAR_BETTER = 0.7  # likewise, to win without a fit: of a plain object only the silhouette moves
CLEARLY_NEARER = 0.45  # squared distance from the model, winner over declared
LARGEST_RESIDUAL = 0.445  # of the winner: right vectors reach at most 0.42, chance at least 0.467
AS_DECLARED = 1.03  # largest residual as declared over the least that keeps the declaration: slow vectors gain little
ALIKE = 1.1  # residual over the least; smaller ratios count as equal, and the plainest map wins
NOTHING = Affine(np.zeros((2, 2)))
# Least confidence by blocks of the picture, and over no motion, that confirms a finding: below, they limit its own.
LEAST_IN_BLOCKS, LEAST_THAN_NONE = 0.75, 0.25
LEAST_IN_BLOCK, MOST_BLOCKS = 8, 10_000  # points of a block that counts, in all pairs; blocks of a row, at most
# Residual under a factor that wins, over that without motion: highlights and plain things that turn follow neither, and
# a small factor is nearly no motion. A map without such a factor has to be better, no more.
SHOWN = 0.97
SIZES = 2.0 ** (np.arange(-16, 17) / 4.0)  # factors tried first; the best is then refined
FINER_SIZES = (2.0**0.125, 2.0**0.0625)
LEAST_SIZE = 1.4  # a factor nearer to 1, or to 1 over it, is none
# Share of the gain over no motion that a whole factor may lose. Where pictures are linear, a factor that is wrong by x
# loses x^2: 1/4 in place of 1/5 loses 6 %, 4 in place of 3 11 %.
SIMPLER = 0.10
INEXACT = 0.15  # relative error of a factor of slow vectors
OF_GAIN = 0.15  # share of the gain over no motion that maps counted as equal may lose
LEAST_EFFECT_PX = 0.08  # a mistake that changes the vectors by less is not reported
MOST_POINTS = 8000  # tested for each of three dozen maps; more only cost time
FEW_POINTS = 1500  # for each of a hundred factors
MOST_SEEN = 800  # compared pairwise, each with each
LEAST_FILLED = 6  # pairs with vectors that fill the picture: leaves four second differences for two gains of each axis
JITTERED = {
    "jittered": "the vectors contain the change of jitter",
    "jittered-reversed": "the vectors contain the change of jitter, with the other sign",
    "not-jittered": "the vectors do not contain the change of jitter, which motion.jittered takes out of them",
}


def check_motion(shot: Shot, settled: Shifts, maps: Mapping[str, Affine] | None = None) -> list[Finding]:
    """Return findings about the motion channel, from the ``settled_shifts`` of the picture.

    ``maps`` are its possible meanings, the declared one under the empty name; by default all. One half of the pixels
    chooses and fits a meaning, the other half judges it.
    """
    shifts, anchored = settled
    scenes, judges = _scenes(shot, shifts, anchored)
    if not any(scene.own.any() for scene in scenes):
        return _resting_leak(shot)
    width, height = shot.window
    usual_maps = maps or affine_maps(width, height, shot.unit)
    sized = {} if maps else {name: meant for name, meant in _sized(scenes).items() if name not in usual_maps}
    maps = {**usual_maps, **sized}
    odd = [name for name, meant in sized.items() if math.log2(abs(meant.matrix[0, 0])) % 1.0]
    residuals = {name: float(_score(scenes, meant).mean()) for name, meant in maps.items()}
    usual = {name: left for name, left in residuals.items() if name not in odd}
    explained = min(residuals.values()) < BETTER * min(usual.values())  # by an odd factor alone
    best = _plainest(residuals if explained else usual, float(_score(scenes, NOTHING).mean()))
    if _effect(scenes, maps[best]) < LEAST_EFFECT_PX:
        best = ""
    judges = [_staying(judge, maps[best]) for judge in judges]
    declared, winner, nothing = (_score(judges, meant) for meant in (maps[""], maps[best], NOTHING))
    shown = (SHOWN if best in sized else 1.0) * nothing.mean()
    wins = winner.mean() < min(LARGEST_RESIDUAL, shown) and (winner < declared).mean() > 0.7
    ratio = float(winner.mean() / declared.mean()) if wins else 1.0
    coarse = list[Finding]()
    if best and ratio < 1.0:
        sure = _sureness(judges, judges, maps[best])
        if np.median([len(scene.x) for scene in scenes]) < 2 * LEAST_POINTS:  # which chose it, too
            sure = min(sure, DOUBTFUL)
        coarse = [_named(best, maps[best], declared, winner, sure)]
    near = bool(coarse) and (ratio < FAR_BETTER or _stays(scenes, maps[best]))
    if near and ratio < CLEARLY_BETTER:
        return coarse
    finer = _finer(scenes, judges, linear_maps(width, height), shot.leaks) if anchored else []
    finer = finer or _resting_leak(shot)
    if near and ratio < BETTER and not any("jittered" in finding.name for finding in finer):
        return coarse
    if coarse and anchored and not finer and _confirmed(scenes, maps[best]):
        return coarse
    return finer


def _sized(scenes: Sequence[Observed]) -> dict[str, Affine]:
    """Return the factor and sign of the vectors under which the pictures match best, and the powers of two beside it,
    by name."""
    few = [_thinned(scene) for scene in scenes[:: max(1, len(scenes) // 3)]]

    def left(sign: str, factor: float) -> float:
        return float(_score(few, Affine(factor * np.diag(SIGNS[sign]))).mean())

    sizes = [size for size in SIZES if _is_size(size)]
    sign, best = min(product(SIGNS, sizes), key=lambda one: left(*one))
    for step in FINER_SIZES:
        best = min((best, best / step, best * step), key=lambda size: left(sign, size))
    least, nothing = left(sign, best), left(sign, 0.0)
    plain = whole(best)
    below = 2.0 ** math.floor(math.log2(best))
    best = plain if left(sign, plain) <= least + SIMPLER * max(nothing - least, 0.0) else best
    made = (scaled(size, sign) for size in (below, 2.0 * below, best) if _is_size(size))
    return {name: Affine(matrix) for name, matrix in made}


def _is_size(factor: float) -> bool:
    return max(factor, 1.0 / factor) >= LEAST_SIZE


def _thinned(scene: Observed) -> Observed:
    """Return ``scene`` at a few of its points, enough to choose a factor."""
    some = slice(None, None, -(-len(scene.x) // FEW_POINTS))
    return scene._replace(own=scene.own[:, some], x=scene.x[some], y=scene.y[some], now=scene.now[some])


def _plainest(residuals: Mapping[str, float], nothing: float) -> str:
    """Return, of the maps with about the least residual, the one with the fewest words; ``nothing`` is the residual
    without motion, which slow vectors lower by little."""
    least = min(residuals.values())
    alike = min(ALIKE * least, least + OF_GAIN * max(nothing - least, 0.0))
    return min(
        (name for name in residuals if residuals[name] <= (alike if name else AS_DECLARED * least)),
        key=lambda name: (len(name.split()), residuals[name]),
    )


def _effect(scenes: Sequence[Observed], meant: Affine) -> float:
    """Return the root mean square change of the vectors by the mistake, in pixels."""
    return _rms([meant(scene.own) - scene.own for scene in scenes])


def _rms(vectors: Sequence[Vector]) -> float:
    """Return the root mean square length of vectors [2, n] of each pair, averaged over the pairs."""
    return float(np.mean([np.sqrt((of_pair**2).sum(0).mean()) for of_pair in vectors]))


def _stays(scenes: Sequence[Observed], meant: Affine) -> bool:
    """Return True if a fit that starts from the mapped vectors stays near them."""
    started = _started(scenes, meant)
    return _is_near(fit_model(started), started, np.eye(2), None, _effect(scenes, meant))


def _confirmed(scenes: Sequence[Observed], meant: Affine) -> bool:
    """Return True if the model, started from the mapped vectors, stays nearer to them than to the declared ones.

    From declared fractions of a picture, which mean almost no motion, a fit would never reach them.
    """
    model = fit_model(_started(scenes, meant))
    declared, no_leak = np.asarray(np.linalg.inv(meant.matrix), np.float64), np.zeros((2, 2))
    return model.distance(np.eye(2), no_leak) < CLEARLY_NEARER * model.distance(declared, no_leak)


def _started(scenes: Sequence[Observed], meant: Affine) -> list[Observed]:
    return [scene._replace(own=meant(scene.own)) for scene in scenes]


def _is_near(model: Model, scenes: Sequence[Observed], gain: Vector, leak: float | None, effect: float) -> bool:
    """Return True if the model moves the picture as ``gain`` does, to a share of the mistake's ``effect`` in pixels.

    Also compares ``leak`` unless it is None. Directions without vectors and jitter do not matter.
    """
    off = (model.gain - gain, np.zeros((2, 2)) if leak is None else model.leak - leak * np.eye(2))
    return _rms([off[0] @ scene.own + (off[1] @ scene.jitter_change)[:, None] for scene in scenes]) <= NEAR * effect


def _scenes(shot: Shot, shifts: Sequence[Fit | None], anchored: bool) -> tuple[list[Observed], list[Observed]]:
    """Return the points of each pair for fitting and those for judging; equal if there are few."""
    fitted, judging = list[Observed](), list[Observed]()
    for pair, fit in zip(shot.pairs, shifts, strict=True):
        there = seen_before(pair, pair.own, pair.moving & pair.usable)
        if there.sum() < LEAST_POINTS or (anchored and fit is None):
            continue
        shift = fit.shift if anchored and fit is not None else None
        back = pair.held_back
        halves = [there & ~back, there & back]
        if min(half.sum() for half in halves) < 2 * LEAST_POINTS:
            halves = [there, there]
        for half, into in zip(halves, (fitted, judging), strict=True):
            chosen = np.flatnonzero(half)[:: -(-int(half.sum()) // MOST_POINTS)]
            own, x, y, now = pair.own[:, chosen], pair.x[chosen], pair.y[chosen], pair.now[chosen]
            into.append(Observed(own, x, y, now, pair.before, pair.scale, shift, pair.jitter_change))
    return fitted, judging


def _staying(scene: Observed, meant: Affine) -> Observed:
    """Return ``scene`` at points that the mapped vectors also keep in the picture, unless these are few."""
    _, height, width = scene.before.shape
    there = stays_inside(np.stack([scene.x, scene.y]) + meant(scene.own), width, height)
    if there.mean() < COVERED:
        return scene
    x, y, now = scene.x[there], scene.y[there], scene.now[there]
    return scene._replace(own=scene.own[:, there], x=x, y=y, now=now)


def _score(scenes: Sequence[Observed], meant: Affine) -> Vector:
    """Return the residual of each pair under the mapped vectors."""
    return np.array([of_pair.mean() for of_pair in _differences(scenes, meant)])


def _differences(scenes: Sequence[Observed], meant: Affine) -> list[Vector]:
    """Return the differences of the points of each pair under the mapped vectors."""
    found = []
    for scene in scenes:
        u, v = meant(scene.own)
        x, y = scene.x + u, scene.y + v
        shift = find_shift(scene.now, scene.before, x, y, scene.scale)[0] if scene.shift is None else scene.shift
        found.append(differences(scene.now, scene.before, x + shift[0], y + shift[1], scene.scale))
    return found


def _sureness(judges: Sequence[Observed], mended: Sequence[Observed], meant: Affine) -> float:
    """Return the confidence that ``meant`` of the ``mended`` vectors is better than those declared, and than none.

    All pairs show the same things, of which one highlight may speak for a wrong map: things in other places must agree.
    """
    places = np.concatenate([scene.y // BLOCK * MOST_BLOCKS + scene.x // BLOCK for scene in judges])
    _, block = np.unique(places, return_inverse=True)
    there = np.bincount(block) >= LEAST_IN_BLOCK

    def left(scenes: Sequence[Observed], meant: Affine) -> tuple[Vector, Vector]:
        of_points = _differences(scenes, meant)
        of_blocks = np.asarray(np.bincount(block, np.concatenate(of_points))[there], np.float64)
        return np.array([of_pair.mean() for of_pair in of_points]), of_blocks

    winner = left(mended, meant)
    others = [left(judges, PLAIN)] + ([left(judges, NOTHING)] if mended is judges else [])
    both = [found for other in others for found in zip(other, winner, strict=True)]
    pairs, blocks, *than_none = (sureness(*found) if len(found[0]) else 0.0 for found in both)
    confirmed = blocks >= LEAST_IN_BLOCKS and min(than_none, default=1.0) >= LEAST_THAN_NONE
    return pairs if confirmed else min(pairs, blocks, *than_none)


def _named(best: str, meant: Affine, declared: Vector, winner: Vector, sure: float) -> Finding:
    evidence = f"residual {winner.mean():.3f} against {declared.mean():.3f} as declared, "
    evidence += f"better in {int((winner < declared).sum())} of {len(declared)} pairs"
    what = f"the motion vectors are {spoken(best)}"
    return mistake(f"motion-{best}", what, evidence, sure, meant.fix)


def _finer(
    scenes: Sequence[Observed], judges: Sequence[Observed], maps: Mapping[str, Vector], leaks: Mapping[str, int]
) -> list[Finding]:
    """Find mistakes smaller than the width of an edge: factors of slow vectors, and jitter left in them."""
    model = fit_model(scenes)
    sized = dict(_fitted_sizes(model))
    maps = dict(maps) | sized
    distances = explanations(model, maps, leaks)
    best = min(distances, key=lambda name: distances[name])
    nothing = model.distance(np.zeros((2, 2)), np.zeros((2, 2)))
    if not best or distances[best] > CLEARLY_NEARER * min(distances[""], nothing):
        return []
    held = leaks.get(best, 0)
    matrix = np.eye(2) if held else maps[best]
    moved = _rms([held * scene.jitter_change[:, None] for scene in scenes]) if held else _effect(scenes, Affine(matrix))
    if moved < LEAST_EFFECT_PX or not _is_near(model, scenes, matrix, -held or None, moved):
        return []
    if held and _rms([_unlike(scene) for scene in scenes]) > NEAR * moved:
        return []
    fix: dict[str, object] = {"jittered": held} if held else linear_fix(matrix)
    gain, leak = model.gain.round(2).tolist(), model.leak.round(2).tolist()
    mended = judges
    if held:
        mended = [judge._replace(own=judge.own - held * judge.jitter_change[:, None]) for judge in judges]
    declared, winner = _score(judges, PLAIN), _score(mended, Affine(matrix))
    if not held and winner.mean() > (SHOWN if best in sized else 1.0) * _score(judges, NOTHING).mean():
        return []
    evidence = f"true vectors = {gain} x declared + {leak} x change of jitter, over {len(scenes)} pairs; "
    evidence += f"residual of other pixels {winner.mean():.3f} against {declared.mean():.3f}"
    what = JITTERED[best] if held else f"the motion vectors are {spoken(best)}"
    return [mistake(f"motion-{best}", what, evidence, _sureness(judges, mended, Affine(matrix)), fix)]


def _unlike(scene: Observed) -> Vector:
    """Return the measured shift less the declared one, [2, 1]: what noise hides of jitter looks like a leak."""
    return (np.zeros(2) if scene.shift is None else scene.shift - scene.jitter_change)[:, None]


def _fitted_sizes(model: Model) -> Iterator[tuple[str, Vector]]:
    """Yield the name and the map of the simple factor near the model under each sign, unless it is about 1.

    Other factors are more often a mean of what follows its vectors and of highlights that rest.
    """
    none = np.zeros((2, 2))
    for sign, factors in SIGNS.items():
        # The squared distance is a parabola of the factor f, a - 2 b f + c f^2: its values at -1, 0 and 1 give b / c.
        back, at_0, ahead = (model.distance(f * np.diag(factors), none) for f in (-1.0, 0.0, 1.0))
        best = (back - ahead) / 2.0 / max(back + ahead - 2.0 * at_0, 1e-12)
        if best > 0.0 and _is_size(best) and 1.0 / SIZES[-1] <= best <= SIZES[-1]:
            near = (size for size in simple(best) if _is_size(size) and abs(best / size - 1.0) < INEXACT)
            yield from (scaled(size, sign) for size in [*near][:1])


def without_leak(shot: Shot) -> Shot:
    """Return ``shot`` with the to-and-fro vectors of resting pixels subtracted, to measure the jitter with the rest.

    Does not use the declared jitter; returns ``shot`` itself if there is no such leak.
    """
    pairs = [pair for pair in shot.pairs if fills(pair)]
    if len(pairs) < max(LEAST_FILLED, len(shot.pairs)) or not (shot.has_camera and shot.has_depth):
        return shot
    leak = np.array([resting_offset(pair) for pair in pairs])
    leak -= leak.mean(0)  # a surface that fills the picture may move steadily
    if not to_and_fro(leak) or np.abs(leak).max() > FARTHEST_PX:
        return shot
    less = copy(shot)
    less.shifts = None
    less.pairs = [replace(p, own=p.own - left[:, None]) for p, left in zip(pairs, leak, strict=True)]
    return less


def may_leak(shot: Shot) -> bool:
    """Return whether vectors fill the picture in too few pairs to tell whether they contain the jitter."""
    return len(shot.pairs) < LEAST_FILLED and all(map(fills, shot.pairs))


def fills(pair: Pair) -> bool:
    """Return whether vectors fill the picture."""
    return bool((np.isfinite(pair.own).all(0) & pair.usable).mean() >= COVERED)


def _resting_leak(shot: Shot) -> list[Finding]:
    """Find jitter left in vectors that cover the whole picture: those of resting pixels follow the jitter."""
    pairs = [pair for pair in shot.pairs if fills(pair)]
    change = np.array([pair.jitter_change for pair in pairs])
    if len(pairs) < LEAST_FILLED or not change.any():
        return []
    # By second differences: a surface that fills the picture moves smoothly, and jitter goes to and fro.
    resting, change = (np.diff(of, n=2, axis=0) for of in (np.array([resting_offset(pair) for pair in pairs]), change))
    fit = regress(resting, change, np.ones(len(change)))
    gain = float(np.trace(fit.matrix)) / 2.0
    name, held = min(shot.leaks.items(), key=lambda leak: abs(leak[1] - gain))
    spread = float(np.sqrt((change**2).sum(1).mean()))
    # Another factor means that the jitter has another unit or sign, which removing it does not correct.
    if left_over(held * change, change, fit.matrix, np.ones(len(change))) > NEAR * spread or fit.left > 0.5 * spread:
        return []
    evidence = f"resting pixels follow {gain:.2f} x the change of jitter over {len(pairs)} pairs, "
    evidence += f"to {fit.left:.2f} px rms"
    sure = float(np.clip(1.0 - fit.left / spread, 0.3, 0.99))
    return [mistake(f"motion-{name}", JITTERED[name], evidence, sure, {"jittered": held})]


def follows(pair: Pair, offset: Vector, share: float = ROUNDED) -> Mask:
    """Return the points whose vectors are the camera's motion plus ``offset``, to rounding and to a ``share`` of it."""
    moved = pair.camera_motion()
    return np.asarray(np.hypot(*(pair.own - moved - offset[:, None])) <= ROUNDED_PX + share * np.hypot(*moved))


def shared_offset(pair: Pair) -> tuple[Vector, bool]:
    """Return ``resting_offset``, and whether the vectors of most of the picture have it, to rounding."""
    offset = resting_offset(pair)
    return offset, bool(follows(pair, offset).mean() >= COVERED)


def resting_offset(pair: Pair) -> Vector:
    """Return the offset of vectors from the camera's motion where most agree, to rounding, else near the median."""
    beyond = pair.own - pair.camera_motion()
    known = np.isfinite(beyond).all(0)
    if not known.any():
        return np.full(2, np.nan)
    beyond, length = beyond[:, known], np.hypot(*pair.own[:, known])
    some = slice(None, None, max(1, -(-len(length) // MOST_SEEN)))
    across, down = (np.subtract.outer(along, along) for along in beyond[:, some])
    alike = across**2 + down**2 <= ((ROUNDED_PX + ROUNDED * length) ** 2)[some]
    most = alike[np.argmax(alike.sum(1))]
    if most.mean() >= UPHELD:  # resting points share one offset, moving points have any
        return np.asarray(np.median(beyond[:, some][:, most], axis=1))
    middle = np.median(beyond, axis=1)
    near = np.hypot(*(beyond - middle[:, None]))
    return np.asarray(np.median(beyond[:, near <= np.quantile(near, 0.5)], axis=1))
