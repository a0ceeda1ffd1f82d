"""How alike two samples are by how far apart they were taken: a judge of jitter that aliasing does not bias.

One sample a pixel of fine patterns is locked to the grid, so that a measured shift comes out too small, or with the
wrong sign. Where the camera stands no shift is needed: any two pixels of any two frames are two samples of one picture,
a whole number of pixels and the change of jitter apart, and they differ the more the farther that is (the variogram of
Matheron, 1963, Principles of geostatistics). The whole pixels anchor the scale: under the right jitter the mean
differences are a smooth function of the distance, under a wrong one they scatter about it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from cltaa.cameras import is_still
from cltaa.checking.shifts import LEAST_ANCHORS
from cltaa.checking.shots import Shot
from cltaa.checking.signal import Vector, squeezed_light
from cltaa.frames import Frame

MOST_FRAMES = 16  # each is held against each
NEIGHBOURS = [(right, down) for down, right in product((-1, 0, 1), repeat=2)]
WAVE = 1.2  # radians a pixel of the longest wave that the function is made of: half of it spans what is compared
ORDERS = [(m, n) for m, n in product(range(4), repeat=2) if m + n <= 3]
LEAST_ROWS = 50  # differences; fewer follow any distance
LEAST_DIFFERENCE = 0.05  # of the light's own spread; below it the picture is flat, and what is left is noise


class Likeness(NamedTuple):
    """Mean differences [n] of the light of two frames, ``apart`` [n, 2] whole pixels; ``now``, ``before`` [n] are the
    places of the two among the frames.
    """

    difference: Vector
    apart: Vector
    now: Vector
    before: Vector

    def scatter(self, jitter: Vector) -> float:
        """Share of the differences' variance that is no smooth function of distance, were ``jitter`` [frames, 2] true.

        Frames whose jitter is NaN are left out; infinite where too few remain.
        """
        right, down = (self.apart - (jitter[self.now] - jitter[self.before])).T
        known = np.isfinite(right + down)
        if known.sum() < LEAST_ROWS:
            return np.inf
        right, down, measured = right[known], down[known], self.difference[known]
        # Even in both, as likeness is, but for the term of a slant.
        waves = [np.cos(WAVE * m * right) * np.cos(WAVE * n * down) for m, n in ORDERS]
        terms = np.stack([*waves, np.sin(right) * np.sin(down)])
        fitted, *_ = np.linalg.lstsq(terms.T, measured, rcond=None)
        return float(((measured - fitted @ terms) ** 2).mean() / max(float(measured.var()), 1e-12))


def measure_likeness(shot: Shot) -> Likeness | None:
    """The likeness of all frames of a camera that stands, at what rests; None where it moves or nothing is seen."""
    frames = shot.frames[:MOST_FRAMES]
    stands = all(is_still(frame.camera, frames[0].camera) for frame in frames)
    if not (shot.has_camera and stands and 0 < len(shot.pairs) == len(shot.frames) - 1):  # no cut, no gap
        return None
    rows, columns = _resting(shot)
    if len(rows) < LEAST_ANCHORS:
        return None
    lights = [squeezed_light(frame.colour) for frame in frames]
    scale = max(2.0 * float(np.std([light[rows, columns] for light in lights])), 1e-6)
    found = []
    for now, before in product(range(len(frames)), repeat=2):
        if now > before:
            here = lights[now][rows, columns]
            for right, down in NEIGHBOURS:
                there = lights[before][rows + down, columns + right]
                mean = np.minimum(np.abs(here - there) / scale, 1.0).mean()
                found.append((float(mean), right, down, now, before))
    if not found:
        return None
    table = np.array(found)
    if table[:, 0].mean() < LEAST_DIFFERENCE:
        return None
    return Likeness(table[:, 0], table[:, 1:3], table[:, 3].astype(int), table[:, 4].astype(int))


def _resting(shot: Shot) -> tuple[Vector, Vector]:
    """Rows and columns of points that rest in every pair, with neighbours all around."""
    first = shot.pairs[0]
    rests = np.logical_and.reduce([pair.usable & ~pair.moving for pair in shot.pairs[: MOST_FRAMES - 1]])
    height, width = first.frame.height, first.frame.width
    inside = (first.x >= 1) & (first.y >= 1) & (first.x < width - 1) & (first.y < height - 1)
    chosen = rests & inside
    return first.y[chosen].astype(int), first.x[chosen].astype(int)


def declared_jitter(frames: Sequence[Frame]) -> Vector:
    """Jitter of each frame, [n, 2]."""
    return np.array([frame.jitter_px for frame in frames[:MOST_FRAMES]], float)
