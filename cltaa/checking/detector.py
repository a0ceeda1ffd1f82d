"""The detector: every check in the order in which one needs the other's answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cltaa.checking.agreement import check_agreement
from cltaa.checking.alignment import LEAST_POINTS, Fit, fit_shift
from cltaa.checking.colour import check_channels, check_colour
from cltaa.checking.depth import check_depth, check_depth_scale, tell_device
from cltaa.checking.finding import Finding
from cltaa.checking.jitter import check_jitter
from cltaa.checking.motion import check_motion
from cltaa.checking.shots import Pair, Shot
from cltaa.checking.travel import check_projection_jitter, check_structure, check_travel
from cltaa.frames import Frame

Mask = NDArray[np.bool_]

LARGEST_RESIDUAL = 0.6  # above it the pictures do not match and a shift means nothing


def check_frames(
    frames: Sequence[Frame],
    window: tuple[int, int] | None = None,
    *,
    has_camera: bool = True,
    has_depth: bool = True,
    has_jitter: bool = True,
) -> list[Finding]:
    """Findings about frames read as their profile says; ``has_*`` is False for what the reader had to fill in.

    ``window`` is the width and height of the display window where the frames show a region of it.

    A later check rests on an earlier one, so where the matrices or the depth are wrong the rest is looked at only as
    far as it does not need them.
    """
    found = check_channels(frames, has_camera=has_camera, has_depth=has_depth) + check_colour(frames)
    if has_camera:
        structure, mend = check_structure(frames)
        found += structure
        if structure and mend is None:
            has_camera = False
        elif mend is not None:
            frames = [replace(frame, camera=mend(frame.camera)) for frame in frames]
    if has_depth and has_camera:
        found += check_depth(frames)
    window = window or (frames[0].width, frames[0].height)
    shot = Shot(frames, window, has_camera=has_camera, has_depth=has_depth, has_jitter=has_jitter)
    two_planes = ("depth-inverse", "depth-device")
    found = [tell_device(shot, finding) if finding.name in two_planes else finding for finding in found]
    wrong_depth = any(finding.name.startswith("depth-") for finding in found)
    if has_camera:
        jittered = check_projection_jitter(shot)
        found += jittered
        if jittered:
            return found
        if not wrong_depth and (agreed := check_agreement(shot)):
            return found + agreed  # the rest is looked at once it is read so
        if not wrong_depth:
            # A wrong camera and a wrong scale of depth both spoil the parallax; the camera's mistakes are the cruder.
            found += check_travel(shot) or (check_depth_scale(shot) if has_depth else [])
    shifts, anchored = measure_shifts(shot)
    if not any(finding.name.startswith(("camera-", "depth-")) and finding.mistake for finding in found):
        wrong_vectors = check_motion(shot, shifts, anchored)
        found += wrong_vectors
        # Shifts that were measured through wrong vectors tell nothing of the jitter, nor do those that hold it.
        if not any(not anchored or finding.name.startswith("motion-jittered") for finding in wrong_vectors):
            found += check_jitter(shot, shifts)
    return found


def measure_shifts(shot: Shot) -> tuple[list[Fit | None], bool]:
    """The shift that jitter gave the picture, for each pair, and whether it was measured without the motion channel."""
    anchors = [_anchor(pair) for pair in shot.pairs]
    anchored = shot.has_camera and bool(anchors) and all(anchor.sum() >= 4 * LEAST_POINTS for anchor in anchors)
    masks = anchors if anchored else [pair.usable for pair in shot.pairs]
    return [_shift(pair, mask, anchored) for pair, mask in zip(shot.pairs, masks, strict=True)], anchored


def _anchor(pair: Pair) -> Mask:
    return pair.usable & ~pair.moving


def _shift(pair: Pair, there: Mask, anchored: bool) -> Fit | None:
    motion = pair.camera_motion() if anchored else pair.declared_motion()
    there = there & np.isfinite(motion).all(0)
    if there.sum() < LEAST_POINTS:
        return None
    x, y = pair.x[there] + motion[0, there], pair.y[there] + motion[1, there]
    fit = fit_shift(pair.now[there], pair.before, x, y, pair.scale)
    return fit if fit.residual < LARGEST_RESIDUAL else None
