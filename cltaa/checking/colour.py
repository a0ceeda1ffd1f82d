"""Whether colour is linear light, a guess; and whether channels hold anything at all, a fact."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cltaa.cameras import is_still
from cltaa.checking.finding import Finding
from cltaa.checking.signal import Vector
from cltaa.frames import Frame
from cltaa.pictures.srgb import encoded
from cltaa.printable import counted

# In linear light a scene that is lit from outside reaches down to its dark paints in shade, some hundredths of its
# white; the sRGB curve lifts these above a tenth (0.01 to 0.1, 0.05 to 0.25), and squeezes everything below 1.
DARKEST_ENCODED, MIDDLE_ENCODED = 0.11, 0.35
SHADOWS = 0.005  # quantile that stands for the dark end; sub-pixel glints and holes are rarer
MOST_FRAMES, MOST_PIXELS = 4, 250_000  # looked at, and of each frame
LEVELS = 255
ON_LEVELS = 0.98  # share of values on 8-bit steps; of float values about 2 in 1000 are, by chance
HALF = 0.5  # a vector of nothing, in pictures that hold no negative numbers
HALF_STEPS = 1e-3  # nearness to a step of 8 bits, in steps


def check_colour(frames: Sequence[Frame]) -> list[Finding]:
    """Guess whether colour is encoded for a display, and find 8-bit sources."""
    step = max(1, frames[0].width * frames[0].height // MOST_PIXELS)
    colour = np.concatenate([frame.colour.reshape(-1, 3)[::step] for frame in frames[:MOST_FRAMES]]).astype(np.float64)
    lit = colour[(colour > 0).any(1) & np.isfinite(colour).all(1)]
    if len(lit) < 100:
        return []
    light = lit.ravel()
    dark, middle, bright = np.quantile(light, [SHADOWS, 0.5, 1.0])
    numbers = f"darkest {SHADOWS:.1%} below {dark:.3f}, middle {middle:.3f}, brightest {bright:.3f}"
    if _share_on_levels(lit) > ON_LEVELS:
        what = "colour consists of 8-bit steps, so it is encoded for a display"
        return [_encoded(what, f"{_share_on_levels(lit):.0%} of all values are k/{LEVELS}; {numbers}", 0.95)]
    darker = np.maximum(light[light < 1.0], 0.0)  # white lies on a step, whatever it was made of
    if bright <= 1.0 and _share_on_levels(encoded(darker)) > ON_LEVELS:
        what = "colour was made linear from 8 bits: its dark steps are coarse and nothing is brighter than white"
        return [Finding(name="colour-8-bit", mistake=False, confidence=0.95, what=what, evidence=numbers)]
    if bright <= 1.0 and dark > DARKEST_ENCODED and middle > MIDDLE_ENCODED:
        confidence = float(min(0.9, 0.5 + 2 * (dark - DARKEST_ENCODED)))
        return [_encoded("colour looks encoded for a display (a guess)", numbers, confidence)]
    return []


def check_channels(frames: Sequence[Frame], *, has_camera: bool, has_depth: bool) -> list[Finding]:
    """Find channels that hold one number only, or nothing that can be used."""
    return [*_channels(frames, has_camera, has_depth)]


def _channels(frames: Sequence[Frame], has_camera: bool, has_depth: bool) -> Iterator[Finding]:
    colour = np.stack([frame.colour for frame in frames])
    wrong = float((~np.isfinite(colour)).mean())
    if wrong:
        yield _channel("colour-not-finite", wrong > 0.001, f"{wrong:.2%} of colour is NaN or infinite", "colour")
    if np.isfinite(colour).any() and np.nanmin(colour) == np.nanmax(colour):
        yield _channel("colour-constant", True, f"every value is {np.nanmin(colour):g}", "colour")
    if len(frames) > 1 and all(np.array_equal(frame.colour, frames[0].colour) for frame in frames[1:]):
        yield _channel("colour-repeated", True, f"all {len(frames)} frames are the same picture", "colour")
    if has_depth:
        depth = np.stack([frame.depth for frame in frames])
        if wrong := float(np.isnan(depth).mean()):  # infinity is the sky
            yield _channel("depth-not-a-number", wrong > 0.001, f"{wrong:.2%} of depth is NaN", "depth")
        finite = depth[np.isfinite(depth)]
        if len(finite) and np.ptp(finite) == 0.0 and len(finite) > 0.5 * depth.size:
            yield _channel("depth-constant", True, f"every depth is {finite[0]:g}", "depth")
    vectors = [frame.motion for frame in frames[1:] if frame.motion is not None]
    if vectors:
        given = np.concatenate([v[np.isfinite(v).all(-1)] for v in vectors])
        if len(given) and not np.ptp(given, axis=0).any():
            text = f"every vector of {counted(len(vectors), 'frame')} is ({given[0, 0]:g}, {given[0, 1]:g})"
            rests = has_camera and all(is_still(f.camera, frames[0].camera) for f in frames)
            if rests and (given[0] == HALF).all():
                yield Finding(
                    name="motion-centred-on-half", mistake=True, confidence=0.9, evidence=text,
                    what="the motion vectors are around 0.5, and nothing moves", fix={"motion": {"offset": [HALF] * 2}},
                )  # fmt: skip
            else:
                yield _channel("motion-constant", not rests or bool(given.any()), text, "motion")


def _channel(name: str, mistake: bool, evidence: str, channel: str) -> Finding:
    what = f"{channel} carries no information" if name.endswith(("constant", "repeated")) else f"{channel} is damaged"
    return Finding(name=name, mistake=mistake, confidence=0.99, what=what, evidence=evidence)


def _encoded(what: str, evidence: str, confidence: float) -> Finding:
    return Finding(
        name="colour-encoded", mistake=True, confidence=confidence, what=what, evidence=evidence,
        fix={"colour": {"encoding": "srgb"}},
    )  # fmt: skip


def _share_on_levels(values: Vector) -> float:
    steps = values[(values > 0) & (values < 1)] * LEVELS
    return float((np.abs(steps - np.round(steps)) < HALF_STEPS).mean()) if len(steps) else 0.0
