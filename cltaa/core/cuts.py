"""Undeclared cuts, found by colour where depth cannot reject wrong history pixel by pixel.

Coarse versions of neighbouring frames of one shot correlate by 0.75 at least, of two shots by about 0
(docs/lab-notes/illumination.md). A found cut starts a new history.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from cltaa.core.constants import value
from cltaa.core.planes import as_floats
from cltaa.frame import Frame, on_device

Coarse = tuple[float | None, ...]  # as ``coarse_colours`` gives it

ROWS, COLUMNS, SAMPLES = 9, 16, 8  # blocks of an image, and samples of each along an axis
LEAST_CORRELATION = 0.5
# With less variance of its logarithms an image shows nothing: black, a fade, a plain wall. So it does where the blocks
# vary by no more than this factor times what their means inherit from the noise within them.
LEAST_VARIANCE, LEAST_SIGNAL = 1e-3, 8.0
LEAST_LIGHT, MOST_LIGHT = 2.0**-6, 2.0**13
LEAST_SHARED = 0.25  # share of the blocks that both images must show


def coarse_colours(frame: Frame) -> Coarse:
    """Return the mean log2 of light in each of ROWS x COLUMNS blocks and three channels, None where all samples
    of a block are missing; () where no cut can be found.

    That is where an image shows nothing but noise; where depth, with its camera or vectors, rejects wrong history pixel
    by pixel; where effects, and so cuts, are declared; and where colour lies on a device.
    """
    refuted = frame.has_depth and (frame.has_camera or frame.motion is not None)
    if refuted or frame.effects is not None or on_device(frame.colour) or not any(frame.colour.strides):
        return ()
    rows, columns = (
        ((np.arange(count * SAMPLES) + 0.5) * (size / (count * SAMPLES))).astype(np.intp)
        for count, size in ((ROWS, frame.height), (COLUMNS, frame.width))
    )
    light = as_floats(frame.colour[rows[:, None], columns, :3])
    levels = np.log2(LEAST_LIGHT + np.clip(light, 0.0, MOST_LIGHT)).astype(np.float64)
    missing = ~(np.abs(light) <= value("DOMAIN_LIMIT")).all(-1, keepdims=True)
    levels = np.ma.masked_where(np.broadcast_to(missing, light.shape), levels)
    blocks = levels.reshape(ROWS, SAMPLES, COLUMNS, SAMPLES, 3)
    means = blocks.mean((1, 3))
    if means.count() == 0:
        return ()
    pixels = min(SAMPLES, frame.height / ROWS) * min(SAMPLES, frame.width / COLUMNS)  # distinct ones of a block
    noise = float(blocks.var((1, 3)).mean()) / max(pixels, 1.0)
    if float(means.var((0, 1)).mean()) < max(LEAST_VARIANCE, LEAST_SIGNAL * noise):
        return ()
    return tuple(means.reshape(-1).tolist())


def looks_cut(before: Coarse, now: Coarse) -> bool:
    """True where two results of ``coarse_colours`` come from different shots; False where either is empty, or the
    blocks that both show are few or plain."""
    if not before or not now:
        return False
    both = np.array([before, now], np.float64).reshape(2, -1, 3)  # None becomes NaN
    shared = both[:, np.isfinite(both).all((0, 2))]
    if shared.shape[1] < LEAST_SHARED * both.shape[1]:
        return False
    # Without the mean of each channel, so that exposure and an overall tint have no effect.
    one, other = shared - shared.mean(1, keepdims=True)
    variances = float(np.mean(one * one)), float(np.mean(other * other))
    if min(variances) < LEAST_VARIANCE:
        return False
    return float(np.mean(one * other)) < LEAST_CORRELATION * sqrt(variances[0] * variances[1])
