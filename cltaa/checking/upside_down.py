"""A projection that turns the picture over, where pictures alone do not tell which way up is right."""

from __future__ import annotations

import numpy as np

from cltaa.checking.agreement import DISAGREE, middle_length
from cltaa.checking.finding import Finding
from cltaa.checking.meanings import MEANINGS
from cltaa.checking.shots import COVERED, Pair, Shot
from cltaa.checking.signal import Vector
from cltaa.checking.travel import CLEARLY_BETTER, camera_residual, moving_pairs


def check_upside_down(shot: Shot) -> list[Finding]:
    """Find a projection that turns the picture over, as Vulkan's does, where the camera moves the same either way.

    A right-handed view and such a projection draw the world mirrored. Only a picture whose rows go up is right so; that
    is believed where the vectors that fill it, or the pixels, bear it out.
    """
    name, clip = "y-flipped", shot.frames[0].camera.view_to_clip
    if not (shot.has_camera and clip[0, 0] > 0.0 > clip[1, 1]):
        return []
    change, pairs = MEANINGS[name].change, moving_pairs(shot)
    turned = [pair.camera_motion(change(pair.frame.camera), change(pair.previous.camera)) for pair in pairs]
    if pairs and all(_borne_out(pair, motion) for pair, motion in zip(pairs, turned, strict=True)):
        return []  # were the vectors turned over too, the check of these would say so
    matched = [camera_residual(pair, pair.camera_motion()) for pair in pairs]
    otherwise = [camera_residual(pair, motion) for pair, motion in zip(pairs, turned, strict=True)]
    if pairs and np.mean(matched) < CLEARLY_BETTER * np.mean(otherwise):
        return []
    what, fix = MEANINGS[name]
    evidence = f"it scales y by {clip[1, 1]:.3g} and x by {clip[0, 0]:.3g}: the world would be seen mirrored"
    return [
        Finding(name=f"camera-{name}", mistake=True, confidence=0.9, what=what, evidence=evidence, fix={"camera": fix})
    ]


def _borne_out(pair: Pair, turned: Vector) -> bool:
    """True where vectors fill the picture that are the declared camera's motion, and not the ``turned`` one [2, n]."""
    if np.isfinite(pair.own).all(0).mean() < COVERED:
        return False
    return middle_length(pair.own - pair.camera_motion()) < DISAGREE * middle_length(pair.own - turned)
