"""The shift that jitter gave the picture, measured for each pair of frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cltaa.checking.alignment import LEAST_POINTS, Fit, fit_shift
from cltaa.checking.shots import Pair, Shot

Mask = NDArray[np.bool_]

LEAST_ANCHORS = 4 * LEAST_POINTS  # that rest in a pair; on fewer the whole picture says more
LARGEST_RESIDUAL = 0.6  # above it the pictures do not match and a shift means nothing


def measure_shifts(shot: Shot) -> tuple[list[Fit | None], bool]:
    """The shift that jitter gave the picture, for each pair, and whether it was measured without the motion channel."""
    anchors = [_anchor(pair) for pair in shot.pairs]
    anchored = shot.has_camera and bool(anchors) and all(anchor.sum() >= LEAST_ANCHORS for anchor in anchors)
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
