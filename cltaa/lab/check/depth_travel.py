"""Find the kind of depth by the depth of other frames, where no plane in view decides (``cltaa.lab.check.depth``).

Matrices and the right depth of a frame predict the depth of another one, whatever shape the surfaces have. Samples that
lie anywhere in their pixels miss it as often one way as the other: in the middle of a block of pixels little of that is
left, and all that a wrong kind makes wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.camera import displacement, is_still, reprojected
from cltaa.frame import Frame
from cltaa.inputs.bilinear import sample
from cltaa.inputs.profile import Depth, DepthKind
from cltaa.lab.check.depth import ALONG, AS_DECLARED, RECIPROCAL, REVERSED, inverse_as, other_readings
from cltaa.lab.check.hypotheses import Finding, mistake, sureness
from cltaa.lab.check.registration import BLOCK, COVERED, Shot, Vector

Pairs = Sequence[tuple[Frame, Frame]]

FARTHEST = 4  # frames apart: kinds differ more than of neighbours, and most of the picture is still in view
MOST_PAIRS, LEAST_BLOCKS = 4, 20
ROUNDED = 1e-5  # relative error of depth by the rounding of floats and by interpolation; 3e-7 was seen
# Largest error in the middle of a block over that of its pixels: a wrong kind has 1, and scattered samples the standard
# error of a median of 64, 1.25 / 8. This is the geometric mean.
SCATTERED = 0.4
UNKNOWN = np.inf, np.inf  # errors of a pair
CLEARLY_WORSE = 3.0  # least error of another kind over that of the right one
WHAT = {
    DepthKind.PLANAR: f"depth is the distance along {ALONG['planar']}",
    DepthKind.RAY: f"depth is the distance along {ALONG['ray']}",
    DepthKind.INVERSE: RECIPROCAL,
    DepthKind.DEVICE_REVERSED: REVERSED,
}


class _Errors(NamedTuple):
    """Relative errors of predicted depth in each pair, [n]: of pixels, and in the middle of blocks."""

    pixels: Vector
    blocks: Vector

    @property
    def size(self) -> float:
        """Error in the middle of blocks; infinite if too few are known."""
        return float(np.median(self.blocks)) if np.isfinite(self.blocks).all() else np.inf

    @property
    def fits(self) -> bool:
        """True if rounding and scattered samples explain the error."""
        return self.size <= max(ROUNDED, SCATTERED * float(np.median(self.pixels))) and np.isfinite(self.size)


def check_kind(shot: Shot, rule: Depth) -> list[Finding]:
    """Return a finding about the kind of depth, which was read by ``rule``, from frames of a camera that moves."""
    errors = _by_kind(_pairs(shot.frames), rule)
    best = min(errors, key=lambda kind: errors[kind].size)
    if not errors[best].fits:
        return []
    # Between 1/Z and near/Z, which are one under a camera that only turns, tell_device decides.
    best = next(kind for kind in errors if _alike(kind, best) and not _clearly_worse(errors[kind], errors[best]))
    if best == rule.kind or not _alone(errors, best):
        return []
    declared, winner = errors[rule.kind], errors[best]
    evidence = f"it predicts the depth of frames {FARTHEST} apart to {winner.size:.2g} of it as {best} and to "
    evidence += f"{declared.size:.2g} as {rule.kind}, over {len(winner.blocks)} pairs"
    # Of pairs farther and less far apart the factor is alike, not the difference; an error above 1 is no more certain.
    sure = sureness(*(np.log(np.clip(each.blocks, ROUNDED, 1.0)) for each in (declared, winner)))
    return [mistake(f"depth-{best}", WHAT[best], evidence, sure, {"kind": best.value})]


def tells_kind_by_travel(frames: Sequence[Frame]) -> bool:
    """Return True if planar depth predicts that of other frames, and distance along the ray or 1/Z would not."""
    return _alone(_by_kind(_pairs(frames), AS_DECLARED), DepthKind.PLANAR)


def _alone(errors: Mapping[DepthKind, _Errors], kind: DepthKind) -> bool:
    """Return True if depth of this kind fits, and all others are clearly worse, except one that is alike."""
    others = [each for other, each in errors.items() if not _alike(other, kind)]
    return errors[kind].fits and all(_clearly_worse(each, errors[kind]) for each in others)


def _clearly_worse(one: _Errors, other: _Errors) -> bool:
    return one.size >= max(CLEARLY_WORSE * other.size, ROUNDED)


def _alike(one: DepthKind, other: DepthKind) -> bool:
    return one == other or {one, other} == {DepthKind.INVERSE, DepthKind.DEVICE_REVERSED}


def _pairs(frames: Sequence[Frame]) -> Pairs:
    """Return frames FARTHEST apart of one shot, later and earlier, between which a perspective camera moves."""
    found = []
    for place in range(FARTHEST, len(frames)):
        now, between = frames[place], frames[place - FARTHEST + 1 : place + 1]
        if not any(frame.cut for frame in between) and not now.camera.orthographic:
            found.append((now, frames[place - FARTHEST]))
    found = [(now, before) for now, before in found if not is_still(now.camera, before.camera)]
    return found[:: max(1, -(-len(found) // MOST_PAIRS))]


def _by_kind(pairs: Pairs, rule: Depth) -> dict[DepthKind, _Errors]:
    rule = msgspec.structs.replace(rule, sky=None)
    errors = {}
    for read in [rule, *other_readings(rule, pairs[0][0].camera)] if pairs else [rule]:
        depths = [[inverse_as(frame, rule, read) for frame in pair] for pair in pairs]
        found = [_error(*pair, *depth) for pair, depth in zip(pairs, depths, strict=True)]
        errors[read.kind] = _Errors(*np.array(found if len(found) > 1 else [UNKNOWN]).T)
    return errors


def _error(now: Frame, before: Frame, near: Vector, near_before: Vector) -> tuple[float, float]:
    """Return the median relative error of the predicted depth: of all pixels, and in the middle of blocks."""
    height, width = near.shape
    y, x = np.mgrid[:height, :width].astype(np.float64)
    (right, down), (right_before, down_before) = now.jitter_px, before.jitter_px
    try:
        moved = displacement(now.camera, before.camera, width, height)
    except ZeroDivisionError:  # a matrix without an inverse, which a finding tells
        return UNKNOWN
    px, py = x + 0.5 + right - width / 2, y + 0.5 + down - height / 2
    u, v, expected, visible = reprojected(px, py, near, moved, parallel=False)
    there = sample(near_before.astype(np.float32), x + u + right - right_before, y + v + down - down_before)
    known = visible & (near > 0.0) & (expected > 0.0) & (there > 0.0)
    if now.motion is not None and (own := np.isfinite(now.motion).all(-1)).mean() < COVERED:
        known &= ~own
    off = np.where(known, there / np.where(known, expected, 1.0) - 1.0, np.nan)
    blocks = _blocks(off)
    if len(blocks) < LEAST_BLOCKS:
        return UNKNOWN
    return float(np.median(np.abs(off[known]))), float(np.median(np.abs(np.median(blocks, axis=1))))


def _blocks(values: Vector) -> NDArray[np.float64]:
    """Return the values of blocks of which all are known, [n, BLOCK * BLOCK]."""
    height, width = (side // BLOCK for side in values.shape)
    cut = values[: height * BLOCK, : width * BLOCK].reshape(height, BLOCK, width, BLOCK)
    blocks = cut.transpose(0, 2, 1, 3).reshape(-1, BLOCK * BLOCK)
    return np.asarray(blocks[np.isfinite(blocks).all(1)])
