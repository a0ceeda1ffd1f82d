"""The detector: every check in the order in which one needs the other's answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import msgspec
import numpy as np

from cltaa.checking.agreement import check_agreement
from cltaa.checking.colour import check_channels, check_colour
from cltaa.checking.depth import check_depth, check_depth_scale, tell_device
from cltaa.checking.exposure import check_exposure
from cltaa.checking.finding import Finding
from cltaa.checking.jitter import check_jitter
from cltaa.checking.motion import LEAST_EFFECT_PX, check_motion
from cltaa.checking.shifts import measure_shifts
from cltaa.checking.shots import Shot
from cltaa.checking.travel import check_projection_jitter, check_structure, check_travel
from cltaa.checking.upside_down import check_upside_down
from cltaa.frames import Frame


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
    found = check_channels(frames, has_camera=has_camera, has_depth=has_depth)
    found += check_colour(frames) + check_exposure(frames)
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
    found = [_excused(shot, finding) if finding.name == "motion-constant" else finding for finding in found]
    two_planes = ("depth-inverse", "depth-device")
    found = [tell_device(shot, finding) if finding.name in two_planes else finding for finding in found]
    wrong_depth = any(finding.name.startswith("depth-") for finding in found)
    if has_camera:
        jittered = check_projection_jitter(shot)
        found += jittered
        if jittered:
            return found
        if not wrong_depth and (agreed := check_agreement(shot)):
            # The rest is looked at once it is read so. Vectors that can be read are no empty channel.
            readable = any(finding.name.startswith("motion-") for finding in agreed)
            return [one for one in found if not (readable and one.name == "motion-constant")] + agreed
        if not wrong_depth:
            # A wrong camera and a wrong scale of depth both spoil the parallax; the camera's mistakes are the cruder.
            found += check_travel(shot) or check_upside_down(shot) or (check_depth_scale(shot) if has_depth else [])
    shifts, anchored = measure_shifts(shot)
    if not any(finding.name.startswith(("camera-", "depth-")) and finding.mistake for finding in found):
        wrong_vectors = check_motion(shot, shifts, anchored)
        found += wrong_vectors
        # Shifts that were measured through wrong vectors tell nothing of the jitter.
        if anchored or not wrong_vectors:
            found += check_jitter(shot, shifts)
    return found


def _excused(shot: Shot, finding: Finding) -> Finding:
    """No mistake where matrices and depth say the same, as of a plane that the camera moves along."""
    if not (shot.has_camera and shot.has_depth and shot.pairs):
        return finding
    apart = np.concatenate([np.abs(pair.own - pair.camera_motion()) for pair in shot.pairs], axis=1)
    apart = apart[:, np.isfinite(apart).all(0)]
    alike = apart.size > 0 and float(np.median(apart)) < LEAST_EFFECT_PX
    return msgspec.structs.replace(finding, mistake=False) if alike else finding
