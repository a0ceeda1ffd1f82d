"""Check whether the pixels follow the declared jitter: sign, axes, scale, phase, presence, mean.

One sample a pixel of fine patterns is locked to the grid, so a measured shift comes out too small, or with the wrong
sign. A still camera needs no measured shift: any two pixels of any two frames are two samples of one picture, at a
distance of whole pixels plus the change of jitter, and they differ more with distance (the variogram of Matheron, 1963,
Principles of geostatistics). The whole pixels fix the scale: under the right jitter the mean differences are a smooth
function of the distance, under a wrong one they scatter about it.

Still surfaces move on the pixel grid by minus the change of jitter. For a still camera the differences of all samples
identify their jitter. Else the measured shift between two frames must equal the declared change, and a least-squares
map from one to the other identifies the mistake.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from cltaa.camera import is_still
from cltaa.core.frame_checks import LARGEST_JITTER
from cltaa.frame import Frame
from cltaa.lab.check.hypotheses import (
    DOUBTFUL,
    LEAST_SHIFT_PX,
    NEAR,
    Finding,
    left_over,
    linear_fix,
    linear_maps,
    mistake,
    regress,
    spoken,
    sureness,
    to_and_fro,
)
from cltaa.lab.check.motion import LEAST_FILLED, fills, shared_offset
from cltaa.lab.check.registration import (
    LEAST_ANCHORS,
    Fit,
    Pair,
    Shifts,
    Shot,
    Vector,
    measure_shifts,
    squeezed_light,
)
from cltaa.printable import counted

MOST_FRAMES = 16  # compared pairwise, each with each
NEIGHBOURS = [(right, down) for down, right in product((-1, 0, 1), repeat=2)]
WAVE = 1.2  # radians per pixel of the longest cosine in the fit: half of its wave spans the distances compared
ORDERS = [(m, n) for m, n in product(range(4), repeat=2) if m + n <= 3]
LEAST_ROWS = 50  # differences; fewer fit any jitter
LEAST_DIFFERENCE = 0.05  # of the light's own spread; a smaller difference is noise of a flat picture


class Likeness(NamedTuple):
    """Mean differences [n] of the light of two frames, ``apart`` [n, 2] whole pixels; ``now``, ``before`` [n] index the
    two frames."""

    difference: Vector
    apart: Vector
    now: Vector
    before: Vector

    def scatter(self, jitter: Vector) -> float:
        """Return the share of the differences' variance that is no smooth function of distance under ``jitter`` [n, 2].

        Leaves out frames whose jitter is NaN; infinite if too few remain.
        """
        errors, spread = self._errors(jitter)
        return float(np.nanmean(errors**2) / spread) if errors.size else np.inf

    def sureness(self, declared: Vector, winner: Vector) -> float:
        """Return the confidence, from each frame, that ``winner`` gives the smoother function."""
        errors = [self._errors(jitter)[0] ** 2 for jitter in (declared, winner)]
        frames = np.unique(self.now[np.isfinite(errors).all(0)])
        return sureness(*(np.array([np.nanmean(error[self.now == frame]) for frame in frames]) for error in errors))

    def _errors(self, jitter: Vector) -> tuple[Vector, float]:
        """Return the error of each difference from the smooth function, NaN if unknown, and the variance of all."""
        right, down = (self.apart - (jitter[self.now] - jitter[self.before])).T
        known = np.isfinite(right + down)
        if known.sum() < LEAST_ROWS:
            return np.empty(0), 1.0
        # Even functions of both axes, like the differences, except the term for diagonal patterns.
        right, down, measured = right[known], down[known], self.difference[known]
        waves = [np.cos(WAVE * m * right) * np.cos(WAVE * n * down) for m, n in ORDERS]
        terms = np.stack([*waves, np.sin(right) * np.sin(down)])
        fitted, *_ = np.linalg.lstsq(terms.T, measured, rcond=None)
        errors = np.full(len(known), np.nan)
        errors[known] = measured - fitted @ terms
        return errors, max(float(measured.var()), 1e-12)


def measure_likeness(shot: Shot) -> Likeness | None:
    """Return the likeness of all frames of a still camera at resting points; None if it moves, the light is flat, or
    the jitter has few positions."""
    frames = shot.frames[:MOST_FRAMES]
    stands = all(is_still(frame.camera, frames[0].camera) for frame in frames)
    if not (shot.has_camera and stands and 0 < len(shot.pairs) == len(shot.frames) - 1):  # no cut, no gap
        return None
    if _positions(shot) < LEAST_POSITIONS:
        return None
    rows, columns = _resting(shot)
    if len(rows) < LEAST_ANCHORS:
        return None
    lights = [squeezed_light(frame.colour) for frame in frames]
    scale = max(2.0 * float(np.std([light[rows, columns] for light in lights])), 1e-6)
    around = [[light[rows + down, columns + right] for right, down in NEIGHBOURS] for light in lights]
    found = []
    for before, now in combinations(range(len(frames)), 2):
        here = lights[now][rows, columns]
        for (right, down), there in zip(NEIGHBOURS, around[before], strict=True):
            found.append((float(np.minimum(np.abs(here - there) / scale, 1.0).mean()), right, down, now, before))
    table = np.array(found)
    if table[:, 0].mean() < LEAST_DIFFERENCE:
        return None
    return Likeness(table[:, 0], table[:, 1:3], table[:, 3].astype(int), table[:, 4].astype(int))


def _resting(shot: Shot) -> tuple[Vector, Vector]:
    """Return rows and columns of points that rest in every pair, inside the border; translucent ones count too."""
    first = shot.pairs[0]
    rests = np.logical_and.reduce([pair.lit & ~pair.moving for pair in shot.pairs[: MOST_FRAMES - 1]])
    height, width = first.frame.height, first.frame.width
    inside = (first.x >= 1) & (first.y >= 1) & (first.x < width - 1) & (first.y < height - 1)
    chosen = rests & inside
    return first.y[chosen].astype(int), first.x[chosen].astype(int)


def declared_jitter(frames: Sequence[Frame]) -> Vector:
    """Return the jitter of each frame, [n, 2]."""
    return np.array([frame.jitter_px for frame in frames[:MOST_FRAMES]], float)


def stays_in_pixel(changes: Vector) -> bool:
    """Return True if ``changes`` [n, 2] of position sum up to less than a centred jitter spans."""
    return bool(np.ptp(np.cumsum(changes, axis=0), axis=0).max() <= 2.0 * CENTRED_PX)


def _positions(shot: Shot) -> int:
    return len(np.unique(declared_jitter(shot.frames), axis=0))


LEAST_POSITIONS = 5  # of samples in a pixel; distances between fewer fit many maps, and to and fro between two any
LEAST_PAIRS = 4  # two unknown gains for each axis, plus a rest to separate signal from noise
LEAST_JITTER_PX, MOST_APART = 0.2, 0.5  # least undeclared jitter; largest difference of two halves, over the shift
MOST_LEFT_PX = 0.45  # root mean square; with a greater error something else than jitter moved the picture
CLEARLY_BETTER = 0.85  # error of another map over that as declared
CENTRED_PX = 0.55  # largest centred jitter
LARGEST_MEAN_PX = 0.15  # a centred jitter of at least 8 samples stays below, even for part of a period
MOST_OF_EFFECT = 0.75  # error of the better map over what the mistake changes: with more, the pixels hardly show it
CLEARLY_SCALED = 0.6  # error of a map of half or twice the size over others: aliasing makes shifts too small
DELAYS = (-2, -1, 1, 2)
HALVES = ("scaled", "units-ndc")
SURE_OF_HALF = 0.95  # confidence to accept half or twice the jitter if it is not far better than the whole
SMOOTH_ALIKE = 1.1  # scatter over the least; smaller ratios count as equal
MOST_SCATTER = 0.4  # with more scatter, something else than distance makes samples differ
LARGEST_LEFT = 0.5  # of the jitter's own change: shifts with a larger error confirm nothing
CLEARLY_SMOOTHER = 0.87  # scatter of another map of the same size over that as declared


def check_jitter(shot: Shot) -> list[Finding]:
    """Return findings about the declared jitter."""
    found = check_mean(shot)
    if _positions(shot) == 2:
        return found
    likeness = measure_likeness(shot)
    judged = None if likeness is None else _by_likeness(shot, likeness)
    return found + (_by_shifts(shot) if judged is None else judged)


def _by_likeness(shot: Shot, likeness: Likeness) -> list[Finding] | None:
    """Return findings for a still camera; None if the samples are inconclusive."""
    declared = declared_jitter(shot.frames)
    maps = linear_maps(*shot.window) | {"absent": np.zeros((2, 2))}
    scatter = {name: likeness.scatter(declared @ matrix.T) for name, matrix in maps.items()}
    best = _plainest_smooth(scatter)
    by_delay = {delay: _delayed(shot, declared, delay) for delay in DELAYS}
    late = min(by_delay, key=lambda delay: likeness.scatter(by_delay[delay]))
    known = np.isfinite(by_delay[late])
    left = likeness.scatter(by_delay[late])
    plain, other = (likeness.scatter(np.where(known, declared @ maps[name].T, np.nan)) for name in ("", best))
    if left < min(MOST_SCATTER, CLEARLY_SMOOTHER * min(plain, other)):
        evidence = f"differences of all samples are a function of distance but for {left:.0%} with the jitter of "
        evidence += f"{_frames(late)}, {plain:.0%} as declared"
        return [_late(late, evidence, likeness.sureness(np.where(known, declared, np.nan), by_delay[late]))]
    if scatter[best] > MOST_SCATTER:
        return None
    if scatter[best] > CLEARLY_SMOOTHER * scatter[""]:
        return []
    evidence = f"differences of all samples are a function of distance but for {scatter[best]:.0%} so, "
    evidence += f"{scatter['']:.0%} as declared, over {counted(len(declared), 'frame')}"
    what, fix = _meaning(best, maps[best])
    sure = likeness.sureness(declared, declared @ maps[best].T)
    # Half or twice the size must be far better than any map that keeps the size, as for shifts (``_plainest``).
    whole = min(left for name, left in scatter.items() if not name.startswith(HALVES))
    if best.startswith("scaled") and scatter[best] > CLEARLY_SCALED * whole and sure < SURE_OF_HALF:
        sure = min(sure, DOUBTFUL)
    return [mistake(f"jitter-{best}", what, evidence, sure, fix)]


def _plainest_smooth(scatter: Mapping[str, float]) -> str:
    """Return, of the maps with about the least scatter, the declared one, else one that keeps the size."""
    most = SMOOTH_ALIKE * min(scatter.values())
    alike = [name for name in scatter if scatter[name] <= most]
    return min(alike, key=lambda name: (name != "", len(name.split()) + name.startswith(HALVES), scatter[name]))


def _delayed(shot: Shot, declared: Vector, delay: int) -> Vector:
    """Return the jitter of the frames ``delay`` later, [n, 2]; NaN for missing frames."""
    by_index = {frame.index: jitter for frame, jitter in zip(shot.frames, declared, strict=False)}
    nothing = np.full(2, np.nan)
    return np.array([by_index.get(f.index + delay * f.step, nothing) for f in shot.frames[: len(declared)]])


def changes_of(shot: Shot) -> tuple[list[int], list[Fit], Vector, Vector]:
    """Return indices and fits of the pairs with a measured shift, and their measured and declared shifts [n, 2]."""
    fits = {place: fit for place, fit in enumerate(measure_shifts(shot)[0]) if fit is not None}
    measured = np.array([fit.shift for fit in fits.values()])
    declared = np.array([shot.pairs[place].jitter_change for place in fits])
    return [*fits], [*fits.values()], measured, declared


def jitter_evidence(shot: Shot) -> str:
    """Return the evidence that the pixels follow the declared jitter; empty if there is no clear one."""
    declared = declared_jitter(shot.frames)
    likeness = measure_likeness(shot)
    if likeness is not None:
        scatter, without = (likeness.scatter(jitter) for jitter in (declared, 0.0 * declared))
        if scatter <= min(MOST_SCATTER, CLEARLY_SMOOTHER * without):
            evidence = "differences of all samples are a function of distance but for"
            return f"{evidence} {scatter:.0%} with it, {without:.0%} without"
    known, _, measured, change = changes_of(shot)
    if len(known) < LEAST_PAIRS:
        return ""
    # A steady drift is no jitter: the halo of things that move reaches what rests.
    left, size = (float(np.hypot(*shifts.std(0))) for shifts in (measured - change, change))
    if left >= LARGEST_LEFT * size:
        return ""
    return f"shifts of {len(known)} pairs follow it to {left:.2f} px rms, of {size:.2f}"


def settled_shifts(shot: Shot) -> Shifts:
    """Return the shifts of ``measure_shifts``, but the declared ones if pixels at rest follow them: fine
    patterns put measured ones up to a pixel off."""
    fits, anchored = measure_shifts(shot)
    if anchored and jitter_evidence(shot):
        both = zip(fits, shot.pairs, strict=True)
        fits = [None if fit is None else fit._replace(shift=pair.jitter_change) for fit, pair in both]
    return fits, anchored


def _by_shifts(shot: Shot) -> list[Finding]:
    known, fits, measured, declared = changes_of(shot)
    if len(known) < LEAST_PAIRS:
        return []
    weights = _weights(fits)
    present = float(np.sqrt((measured**2).sum(1).mean()))
    if not declared.any():
        return _undeclared(shot, known, fits, measured, present)
    as_declared = left_over(measured, declared, np.eye(2), weights)
    maps = linear_maps(*shot.window) | {"absent": np.zeros((2, 2))}
    left = {name: left_over(measured, declared, matrix, weights) for name, matrix in maps.items()}
    best = _plainest(left)
    delay, delayed, rows, later = _best_delay(shot, known, measured, weights)
    if delayed < CLEARLY_BETTER * min(left[best], as_declared) and left[best] > LEAST_SHIFT_PX:
        evidence = f"shifts of {len(known)} pairs fit the jitter of {_frames(delay)} to {delayed:.2f} px rms, "
        evidence += f"as declared only to {as_declared:.2f} px"
        sure = _sureness([fits[row] for row in rows], declared[rows], later)
        return [_late(delay, evidence, sure)]
    if not best or as_declared < LEAST_SHIFT_PX or left[best] > min(CLEARLY_BETTER * as_declared, MOST_LEFT_PX):
        return []
    # Judge by the error and not the gain, which is undefined on an axis where the jitter hardly changes. The noise of
    # one sample a pixel leaves half of the jitter as error, which is acceptable if the declared map leaves far more.
    size = left_over(0.0 * measured, declared, np.eye(2) if best == "absent" else maps[best], weights)
    if left[best] > NEAR * max(size, as_declared):
        return []
    gain = regress(measured, declared, weights).matrix
    evidence = f"measured shift = [[{gain[0, 0]:.3g}, {gain[0, 1]:.3g}], [{gain[1, 0]:.3g}, {gain[1, 1]:.3g}]] x "
    evidence += f"declared change over {len(known)} pairs; {left[best]:.2f} px rms left, {as_declared:.2f} as declared"
    what, fix = _meaning(best, maps[best])
    sure = _sureness(fits, declared, declared @ maps[best].T)
    # Noise makes measured shifts too small, and a part of the jitter is not an absent jitter.
    effect = left_over(declared @ maps[best].T, declared, np.eye(2), weights)
    if left[best] > MOST_OF_EFFECT * effect or (best == "absent" and np.abs(gain).max() > NEAR / 2.0):
        sure = min(sure, DOUBTFUL)
    return [mistake(f"jitter-{best}", what, evidence, sure, fix)]


def _sureness(fits: Sequence[Fit], declared: Vector, winner: Vector) -> float:
    """Return the confidence that the held-back pixels match better under shifts ``winner`` [n, 2]."""
    pairs = zip(fits, declared, winner, strict=True)
    residuals = np.array([(fit.judge(*one), fit.judge(*other)) for fit, one, other in pairs])
    return sureness(*residuals.T)


def _plainest(left: dict[str, float]) -> str:
    """Return the map with the least error; one of half or twice the size must be far better than the best other one."""
    best = min(left, key=lambda name: left[name])
    if not best.startswith(HALVES):
        return best
    whole = min((name for name in left if not name.startswith(HALVES)), key=lambda name: left[name])
    return best if left[best] < CLEARLY_SCALED * left[whole] else whole


def _weights(fits: Sequence[Fit]) -> Vector:
    """Return weights of pairs by their texture, at most three times the median."""
    strength = np.array([np.sqrt(max(np.linalg.det(fit.information), 0.0)) for fit in fits])
    middle = float(np.median(strength)) or 1.0
    return np.clip(strength / middle, 0.1, 3.0)


def check_mean(shot: Shot) -> list[Finding]:
    """Find a jitter that is not centred; doubtful within the pixel, where part of a period is seldom centred either."""
    offsets = np.array([frame.jitter_px for frame in shot.frames])
    varies = np.ptp(offsets, axis=0).any()
    if len(offsets) < (8 if varies else 2):
        return []
    positions = np.unique(offsets, axis=0)
    repeats = len(positions) < len(offsets)  # then a whole period is seen
    mean = (positions if repeats else offsets).mean(0)
    beyond = np.abs(offsets).max() > CENTRED_PX  # outside the range of centred jitter
    if np.abs(mean).max() <= LARGEST_MEAN_PX or not (beyond or repeats):
        return []
    # The true origin is probably the pixel's corner: the mean of few frames is inexact.
    corner = np.abs(np.abs(mean) - 0.5) < LARGEST_MEAN_PX
    centre = np.where(corner, np.copysign(0.5, mean), mean)
    one_sided = (np.abs(np.sign(offsets[:, corner]).sum(0)) >= len(offsets) - 1).any()
    what = "the jitter is not centred: the resolved picture is shifted by its mean, for good"
    evidence = f"mean ({mean[0]:.3f}, {mean[1]:.3f}) px over {counted(len(offsets), 'frame')}"
    sure = 0.9 if one_sided and (beyond or not varies) else DOUBTFUL
    return [mistake("jitter-biased", what, evidence, sure, {"offset": [round(float(-x), 4) for x in centre]})]


def check_size(shot: Shot) -> list[Finding]:
    """Find a jitter larger than a resolve accepts, if no other finding explains its unit."""
    worst = max(shot.frames, key=lambda frame: np.abs(frame.jitter_px).max())
    if np.abs(worst.jitter_px).max() < LARGEST_JITTER:
        return []
    x, y = worst.jitter_px
    evidence = f"frame {worst.index}: {x:g} {y:g} pixels from the centre, and a sample lies within its pixel"
    what = (
        "the jitter lies outside the pixel: find its unit for jitter.scale (docs/inputs.md);"
        " to go on without it: --input jitter.source=none"
    )
    return [mistake("jitter-size", what, evidence, 0.95)]


def _undeclared(
    shot: Shot, known: Sequence[int], fits: Sequence[Fit], measured: Vector, present: float
) -> list[Finding]:
    if found := _in_vectors(shot, [shot.pairs[place] for place in known], fits, present):
        return found
    if present < LEAST_SHIFT_PX:
        note = f"still regions move by {present:.3f} px rms between frames"
        what = "no jitter is declared and none is seen: there is nothing to accumulate but noise"
        return [Finding(name="jitter-none", mistake=False, confidence=0.8, what=what, evidence=note)]
    if any(np.any(frame.jitter_px) for frame in shot.frames):
        return []
    # Noise and aliasing shift parts of the picture differently; jitter shifts all of it equally.
    halves = np.array([fit.halves for fit in fits])
    sure = _sureness(fits, 0.0 * measured, halves[:, 0])
    apart = float(np.sqrt((np.diff(halves, axis=1) ** 2).sum(2).mean()))
    if present < LEAST_JITTER_PX or apart > MOST_APART * present:
        return []
    drift = -measured.mean(0)  # of the picture; the measured shift is that of the earlier picture
    spread = float(np.sqrt(((measured + drift) ** 2).sum(1).mean()))
    if spread < LEAST_SHIFT_PX or not to_and_fro(measured):
        evidence = f"by ({drift[0]:.2f}, {drift[1]:.2f}) px from frame to frame, within {spread:.2f} px"
        given = [f"{name} do not" for name, there in _given(shot).items() if there]
        what = "the picture moves on and nothing says so: give motion vectors, or matrices and depth"
        if given:
            what = f"the picture moves on and {', '.join(given)} say so"
            sure = sure if spread < LEAST_SHIFT_PX else min(sure, DOUBTFUL)  # things may move without vectors
        name = "motion-disagrees" if given else "motion-missing"
        return [mistake(name, what, evidence, sure)]
    evidence = f"still regions move by {present:.2f} px rms between frames, first by "
    evidence += ", ".join(f"({x:.2f}, {y:.2f})" for x, y in measured[:4])
    what = "the pixels are jittered and no jitter is declared: give jitter_px of each frame with --camera FILE"
    what += ", or measure it with --jitter-file FILE.json"
    return [mistake("jitter-missing", what, evidence, sure)]


def _in_vectors(shot: Shot, pairs: Sequence[Pair], fits: Sequence[Fit], left: float) -> list[Finding]:
    """Find undeclared jitter in vectors that fill the picture, which follows them to ``left`` pixels.

    A camera moves the picture so too. If it stands, most vectors share one offset, and all offsets sum up to less than
    a pixel. Else only matrices and depth tell (``cltaa.lab.check.motion.without_leak``).
    """
    by_matrices = shot.has_camera and shot.has_depth
    if not all(map(fills, pairs)) or (by_matrices and len(shot.pairs) >= LEAST_FILLED):
        return []
    offsets, shared = zip(*map(shared_offset, pairs), strict=True)
    held = np.array(offsets)
    size = float(np.hypot(*held.std(0)))
    if not to_and_fro(held) or left > NEAR * size:
        return []
    evidence = f"the vectors go to and fro by {size:.2f} px rms, and the picture with them to {left:.2f} px"
    if all(shared) and stays_in_pixel(held):
        what = "the pixels are jittered, the vectors contain it, and no jitter is declared: measure it with"
        what += " --jitter-file FILE.json"
        return [mistake("jitter-missing", what, evidence, _sureness(fits, -held, 0.0 * held))]
    without = f"in fewer than {LEAST_FILLED + 1} frames" if by_matrices else "without matrices and depth"
    what = f"{without} nobody can tell whether the vectors contain jitter or the camera moves so: give"
    what += " more frames" if by_matrices else " them with --camera FILE"
    return [mistake("jitter-missing", f"{what}, or the jitter itself", evidence, DOUBTFUL)]


def _given(shot: Shot) -> dict[str, bool]:
    """Return the sources of motion, and whether each is present."""
    vectors = any(frame.motion is not None for frame in shot.frames)
    return {"matrices and depth": shot.has_camera and shot.has_depth, "vectors": vectors}


def _best_delay(
    shot: Shot, known: Sequence[int], measured: Vector, weights: Vector
) -> tuple[int, float, list[int], Vector]:
    """Return the delay in frames whose jitter fits best, its error, the pairs that have it, and its changes there."""
    by_index = {frame.index: np.array(frame.jitter_px) for frame in shot.frames}
    frames = [shot.pairs[place].frame for place in known]
    best: tuple[int, float, list[int], Vector] = (0, np.inf, [], np.empty((0, 2)))
    for delay in DELAYS:
        steps = [(frame.index + (delay - 1) * frame.step, frame.index + delay * frame.step) for frame in frames]
        rows = [row for row, step in enumerate(steps) if by_index.keys() >= {*step}]
        if len(rows) < LEAST_PAIRS:
            continue
        changes = np.array([by_index[now] - by_index[before] for before, now in (steps[row] for row in rows)])
        left = left_over(measured[rows], changes, np.eye(2), weights[rows])
        if left < best[1]:
            best = (delay, left, rows, changes)
    return best


def _frames(delay: int) -> str:
    return f"{counted(abs(delay), 'frame')} {'later' if delay > 0 else 'earlier'}"


def _late(delay: int, evidence: str, confidence: float) -> Finding:
    """Make the finding of a delay: the frame ``delay`` later declares a frame's jitter."""
    what = f"the jitter declared for a frame is that of {_frames(-delay)}"
    return mistake("jitter-late", what, evidence, confidence, {"delay": delay})


def _meaning(best: str, matrix: Vector) -> tuple[str, dict[str, object]]:
    if best == "absent":
        return "jitter is declared but the pixels are not jittered", {"source": "none"}
    return f"the declared jitter is {spoken(best)}", linear_fix(matrix)
