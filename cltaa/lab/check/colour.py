"""Guess whether colour is linear light and exposure is declared; find channels without information."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from cltaa.camera import is_still
from cltaa.frame import Frame
from cltaa.io.display import encoded
from cltaa.io.pixel_statistics import meaningless, meaningless_lines, missing_lines, missing_samples
from cltaa.lab.check.hypotheses import DOUBTFUL, Finding, mistake
from cltaa.lab.check.registration import Vector
from cltaa.printable import counted

# In linear light a lit scene reaches down to dark paint in shade, a few hundredths of its white; the sRGB curve lifts
# these above a tenth (0.01 to 0.1, 0.05 to 0.25), and compresses everything below 1.
DARKEST_ENCODED, MIDDLE_ENCODED = 0.11, 0.35
SHADOWS = 0.005  # quantile used as the dark end; sub-pixel glints and holes are rarer
MOST_FRAMES, MOST_PIXELS = 4, 250_000  # examined frames, and pixels of each
LEVELS = 255
ON_LEVELS = 0.98  # share of values on 8-bit steps; about 2 in 1000 float values are by chance
JUST_WHITE, LEAST_CUT = 1.0 - 1e-6, 1e-4  # white up to the curve's rounding; least share of such pixels
SURE_OF_CUT = 0.9  # confidence of encoded light that was cut off at white
# Least tones below white. Tones of masks and flat graphics lie anywhere: n of them leave out the dark by chance in
# (1 - DARKEST_ENCODED)^n of the pictures, and being sure admits so many. Of even tones those of 18 or fewer shades can
# lie on 8-bit steps, and then of 52.
LEAST_TONES = math.ceil(math.log(1.0 - SURE_OF_CUT) / math.log(1.0 - DARKEST_ENCODED))
HALF = 0.5  # the zero vector in images without negative numbers
HALF_STEPS = 1e-3  # largest distance from an 8-bit step, in steps


def check_colour(frames: Sequence[Frame]) -> list[Finding]:
    """Guess whether colour is encoded for a display, and find 8-bit sources."""
    step = max(1, frames[0].width * frames[0].height // MOST_PIXELS)
    colour = np.concatenate([frame.colour.reshape(-1, 3)[::step] for frame in frames[:MOST_FRAMES]]).astype(np.float64)
    lit = colour[(colour > 0).any(1) & np.isfinite(colour).all(1)]
    if len(lit) < 100:
        return []
    light = lit.ravel()
    if len(np.unique(light[(light > 0.0) & (light < 1.0)])) < LEAST_TONES:
        return []
    dark, middle, bright = np.quantile(light, [SHADOWS, 0.5, 1.0])
    numbers = f"darkest {SHADOWS:.1%} below {dark:.3f}, middle {middle:.3f}, brightest {bright:.3f}"
    if _share_on_levels(lit) > ON_LEVELS:
        what = "colour consists of 8-bit steps, so it is encoded for a display"
        return [_encoded(what, f"{_share_on_levels(lit):.0%} of all values are k/{LEVELS}; {numbers}", 0.95)]
    darker = np.maximum(light[light < 1.0], 0.0)  # white always lies on a step
    if bright <= 1.0 and _share_on_levels(encoded(darker)) > ON_LEVELS:
        what = "colour was made linear from 8 bits: its dark steps are coarse and nothing is brighter than white"
        return [Finding(name="colour-8-bit", mistake=False, confidence=0.95, what=what, evidence=numbers)]
    if bright <= 1.0 and dark > DARKEST_ENCODED and middle > MIDDLE_ENCODED:
        # Light clipped at white was encoded for a display; without clipping it may be a pale scene.
        sure = SURE_OF_CUT if (lit > JUST_WHITE).any(1).mean() > LEAST_CUT else DOUBTFUL
        return [_encoded("colour looks encoded for a display (a guess)", numbers, sure)]
    return []


def check_channels(frames: Sequence[Frame], *, has_camera: bool, has_depth: bool) -> Iterator[Finding]:
    """Find channels that hold only one number, or no usable ones."""
    colour = np.stack([frame.colour for frame in frames])
    missing = [lost for frame in frames if (lost := missing_samples(frame.colour, frame.alpha, frame.index))]
    if missing:
        wrong = sum(each.pixels for each in missing) / sum(frame.width * frame.height for frame in frames)
        text = "; ".join(missing_lines(missing))
        yield _channel("colour-not-finite", wrong > 0.001, text, "colour")
    if np.isfinite(colour).any() and np.nanmin(colour) == np.nanmax(colour):
        yield _channel("colour-constant", bool(np.nanmin(colour)), f"every value is {np.nanmin(colour):g}", "colour")
    elif len(frames) > 1 and all(np.array_equal(frame.colour, frames[0].colour) for frame in frames[1:]):
        yield _channel("colour-repeated", _changes_declared(frames), f"all {len(frames)} frames are one", "colour")
    beyond = [one for frame in frames for one in meaningless(frame, first=True) if "depth" not in one.what]
    for what in dict.fromkeys(one.what for one in beyond):
        (line,) = meaningless_lines([one for one in beyond if one.what == what])
        yield mistake(f"{what.partition(' ')[0]}-beyond-range", what, line, 0.99)
    if has_depth:
        depth = np.stack([frame.depth for frame in frames])
        if wrong := float(np.isnan(depth).mean()):  # infinity is the sky
            yield _channel("depth-not-a-number", wrong > 0.001, f"{wrong:.2%} of depth is NaN", "depth")
        wrong = float((depth < 0.0).mean())
        if 0.0 < wrong < 0.9 * float(np.isfinite(depth).mean()) and not frames[0].camera.orthographic:
            yield _channel("depth-negative-in-part", wrong > 0.001, f"{wrong:.2%} of depth is negative", "depth")
        finite = depth[np.isfinite(depth)]
        if len(finite) and np.ptp(finite) == 0.0 and len(finite) > 0.5 * depth.size:
            is_distance = finite[0] > 0.0 or frames[0].camera.orthographic
            yield _channel("depth-constant", not is_distance, f"every depth is {finite[0]:g}", "depth")
        elif np.isinf(depth).all():
            yield _channel("depth-constant", False, "every depth is infinite", "depth")
    vectors = [frame.motion for frame in frames[1:] if frame.motion is not None]
    if vectors:
        every = np.concatenate([v.reshape(-1, 2) for v in vectors])
        if wrong := float(np.isinf(every).mean()):
            yield _channel("motion-not-finite", wrong > 0.001, f"{wrong:.2%} of motion is infinite", "motion")
        wrong = float(np.isnan(every).mean())  # NaN means camera motion, which needs depth and matrices
        if wrong and not (has_camera and has_depth):
            text = f"{wrong:.2%} of motion is NaN, and there are no matrices and depth that stand in for it"
            yield _channel("motion-not-a-number", False, text, "motion")
        given = every[np.isfinite(every).all(-1)]
        if len(given) and not np.ptp(given, axis=0).any():
            text = f"every vector of {counted(len(vectors), 'frame')} is ({given[0, 0]:g}, {given[0, 1]:g})"
            rests = has_camera and all(is_still(f.camera, frames[0].camera) for f in frames)
            if rests and (given[0] == HALF).all():
                what = "the motion vectors are around 0.5, and nothing moves"
                yield mistake("motion-centred-on-half", what, text, 0.9, {"offset": [HALF] * 2})
            else:
                yield _channel("motion-constant", not rests or bool(given.any()), text, "motion")


def _changes_declared(frames: Sequence[Frame]) -> bool:
    """Return True if a camera, jitter or vectors declare that the picture changes."""
    vectors = (frame.motion for frame in frames[1:] if frame.motion is not None)
    moves = any(np.nan_to_num(motion).any() for motion in vectors)
    return moves or any(f.jitter_px != frames[0].jitter_px or not is_still(f.camera, frames[0].camera) for f in frames)


def _channel(name: str, wrong: bool, evidence: str, channel: str) -> Finding:
    what = f"{channel} carries no information" if name.endswith(("constant", "repeated")) else f"{channel} is damaged"
    # A black leader, a wall before the camera or a few pixels may be intended, but must not count as correct.
    asked = not wrong and name not in ("colour-repeated", "motion-constant")
    confidence = DOUBTFUL if asked else 0.99
    return Finding(name=name, mistake=wrong, confidence=confidence, what=what, evidence=evidence, question=asked)


def _encoded(what: str, evidence: str, confidence: float) -> Finding:
    return mistake("colour-encoded", what, evidence, confidence, {"encoding": "srgb"})


def _share_on_levels(values: Vector) -> float:
    steps = values[(values > 0) & (values < 1)] * LEVELS
    return float((np.abs(steps - np.round(steps)) < HALF_STEPS).mean()) if len(steps) else 0.0


QUANTILES = np.linspace(0.1, 0.9, 9)  # of the light of all pixels; an exposure scales all by one factor
LEAST_CHANGE = 0.1  # of the logarithm, since the shot began; scenes with constant light stay below half of it
# Share of the change by which all quantiles but one may differ; a moving sun makes 0.19 in the second of 24 frames.
# One quantile may lie between the light and the dark of a pattern, where a few pixels more of either move it far.
SPREAD = 0.12
NEAR = 0.25  # share of the declared change by which the pixels' change may differ from it
LEAST_FRAMES = 2  # a single frame may be a lamp that is switched on
LEAST_PIXELS = 100  # least number of pixels with light


def check_exposure(frames: Sequence[Frame]) -> list[Finding]:
    """Find an exposure that changes in the pixels but not in the declaration, and the reverse."""
    changes = list(_changes(frames))
    if not changes:
        return []
    seen = np.array([change for change, _ in changes])
    told = np.array([exposure for _, exposure in changes])
    left = seen - told[:, None]
    middle = np.median(left, axis=1)
    order = np.abs(left - middle[:, None]).argsort(axis=1)
    most = np.take_along_axis(left, order[:, :-1], axis=1)  # all but the farthest
    as_one = (np.ptp(most, axis=1) <= SPREAD * np.abs(middle)) & (np.abs(middle) >= LEAST_CHANGE)
    if as_one.sum() < LEAST_FRAMES:
        return []
    evidence = (
        f"in {as_one.sum()} of {len(frames)} frames all brightnesses have changed by one factor that is not declared, "
        f"{np.exp(middle[as_one].min()):.2f} to {np.exp(middle[as_one].max()):.2f}"
    )
    told, pixels = told[as_one], (middle + told)[as_one]
    declared = NEAR * np.abs(told)
    if (np.abs(told) >= LEAST_CHANGE).all():
        if (np.abs(pixels) <= declared).all():
            what = "the colour was not multiplied by the exposure: leave it out"
            return [mistake("exposure-not-applied", what, evidence, 0.9)]
        if (np.abs(pixels + told) <= declared).all():
            what = "the colour was divided by the exposure: declare one over it"
            return [mistake("exposure-inverted", what, evidence, 0.9)]
    what = "the brightness changes as a whole; if by an exposure, give each frame's factor as exposure in --camera FILE"
    return [Finding(name="exposure-missing", mistake=False, confidence=0.8, what=what, evidence=evidence)]


def _changes(frames: Sequence[Frame]) -> Iterator[tuple[Vector, float]]:
    """Yield the change since the shot began of the logarithm of each quantile of the light, and of the exposure."""
    first, exposure = _light(frames[0]), frames[0].exposure
    for frame in frames[1:]:
        light = _light(frame)
        if frame.cut or first is None:
            first, exposure = light, frame.exposure
        elif light is not None:
            yield light - first, float(np.log(frame.exposure / exposure))


def _light(frame: Frame) -> Vector | None:
    """Return the logarithm of each quantile of the light of lit pixels; None if there are too few."""
    light = frame.colour.mean(-1, dtype=np.float64)
    lit = light[(light > 0) & np.isfinite(light)]
    return None if len(lit) < LEAST_PIXELS else np.asarray(np.log(np.quantile(lit, QUANTILES)), np.float64)
