"""Cuts that nobody declares, found by colour where no depth tells what each pixel showed.

Seen coarsely, neighbouring frames of one shot correlate by 0.75 at least, frames of two shots by about 0
(docs/lab-notes/illumination.md). A frame that is found to be a cut starts a new history.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cltaa.frame import Frame, on_device

ROWS, COLUMNS, SAMPLES = 9, 16, 8  # blocks of a picture, and samples of each along an axis
LEAST_CORRELATION = 0.5
# Less variance of logarithms is a picture that shows nothing: black, a fade, a plain wall. So is one whose blocks
# differ by no more than so many times what the noise within them makes of their means.
LEAST_VARIANCE, LEAST_SIGNAL = 1e-3, 8.0
LEAST_LIGHT, MOST_LIGHT = 2.0**-6, 2.0**13

Coarse = tuple[float, ...]


def coarse_colours(frame: Frame) -> Coarse:
    """Mean logarithm of light in each of ROWS x COLUMNS blocks and three channels; () where no cut can be told.

    That is where a picture shows nothing but noise; where depth and its camera or vectors refute wrong history pixel by
    pixel; where effects are declared, cuts among them or not; and where colour lies on a device.
    """
    refuted = frame.has_depth and (frame.has_camera or frame.motion is not None)
    if refuted or frame.effects is not None or on_device(frame.colour) or not any(frame.colour.strides):
        return ()
    rows, columns = (
        ((np.arange(count * SAMPLES) + 0.5) * (size / (count * SAMPLES))).astype(np.intp)
        for count, size in ((ROWS, frame.height), (COLUMNS, frame.width))
    )
    light = np.nan_to_num(frame.colour[rows[:, None], columns, :3].astype(np.float32))
    levels = np.log2(LEAST_LIGHT + np.clip(light, 0.0, MOST_LIGHT))
    blocks = levels.reshape(ROWS, SAMPLES, COLUMNS, SAMPLES, 3).astype(np.float64)
    means = blocks.mean((1, 3))
    pixels = min(SAMPLES, frame.height / ROWS) * min(SAMPLES, frame.width / COLUMNS)  # of a block that differ
    noise = float(blocks.var((1, 3)).mean()) / max(pixels, 1.0)
    if float(means.var((0, 1)).mean()) < max(LEAST_VARIANCE, LEAST_SIGNAL * noise):
        return ()
    return tuple(means.reshape(-1).tolist())


def looks_cut(before: Coarse, now: Coarse) -> bool:
    """True where two frames of ``coarse_colours`` are of different shots; False where either is empty."""
    if not before or not now:
        return False
    one, other = _centred(before), _centred(now)
    return float(np.mean(one * other)) < LEAST_CORRELATION * float(np.sqrt(np.mean(one * one) * np.mean(other * other)))


def _centred(coarse: Coarse) -> NDArray[np.float64]:
    """Levels without the mean of each channel: an exposure or a tint of all changes nothing."""
    levels = np.array(coarse).reshape(-1, 3)
    centred: NDArray[np.float64] = levels - levels.mean(0)
    return centred
