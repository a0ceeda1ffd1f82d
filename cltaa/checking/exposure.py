"""Whether the whole picture grows brighter or darker by one factor, as an exposure makes it, and is said to do so."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cltaa.checking.finding import Finding
from cltaa.checking.signal import Vector
from cltaa.frames import Frame

QUANTILES = np.linspace(0.1, 0.9, 9)  # of the light of all pixels; an exposure moves each by one factor
LEAST_CHANGE = 0.1  # of the logarithm, since the shot began; scenes that are lit alike stay below half of it
# Of the change, by which all quantiles but one may differ; those of a sun that wanders do by 0.19 in the second of 24
# frames. One may lie between the light and the dark of a pattern: a few pixels more of either move it far.
SPREAD = 0.12
NEAR = 0.25  # of what is declared, by which the change of the pixels may lie beside it
LEAST_FRAMES = 2  # one alone may be a lamp that is switched on
LEAST_PIXELS = 100  # with light


def check_exposure(frames: Sequence[Frame]) -> list[Finding]:
    """Find an exposure that changes in the pixels and not in the frames, and one that does so in the frames alone."""
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
            return [_wrong("not-applied", "the colour was not multiplied by the exposure: leave it out", evidence)]
        if (np.abs(pixels + told) <= declared).all():
            return [_wrong("inverted", "the colour was divided by the exposure: declare one over it", evidence)]
    what = "the picture's brightness changes as a whole; if it is an exposure, give it to each frame with --camera FILE"
    return [Finding(name="exposure-missing", mistake=False, confidence=0.8, what=what, evidence=evidence)]


def _wrong(name: str, what: str, evidence: str) -> Finding:
    return Finding(name=f"exposure-{name}", mistake=True, confidence=0.9, what=what, evidence=evidence)


def _changes(frames: Sequence[Frame]) -> Iterator[tuple[Vector, float]]:
    """By how much the logarithm of each quantile of the light has changed since the shot began, and the exposure's."""
    first, exposure = _light(frames[0]), frames[0].exposure
    for frame in frames[1:]:
        light = _light(frame)
        if frame.cut or first is None:
            first, exposure = light, frame.exposure
        elif light is not None:
            yield light - first, float(np.log(frame.exposure / exposure))


def _light(frame: Frame) -> Vector | None:
    """The logarithm of each quantile of the light of those pixels that have any; None for too few."""
    light = frame.colour.mean(-1, dtype=np.float64)
    lit = light[(light > 0) & np.isfinite(light)]
    return None if len(lit) < LEAST_PIXELS else np.asarray(np.log(np.quantile(lit, QUANTILES)), np.float64)
