"""How much memory a resolve takes: counted in planes, so that it is known before anything is allocated."""

from __future__ import annotations

import numpy as np

from cltaa.build import Build, Steps, Storage, kept_planes
from cltaa.launch import storage_dtype
from cltaa.layout import Layout

REAL = 4  # bytes of a float


def device_bytes(
    width: int, height: int, steps: Steps, storage: Storage = Storage.FLOAT, *, band_rows: int = 0, frames_kept: int = 0
) -> int:
    """Bytes of the planes on the device, halos included.

    Per texel and in floats: the frame holds 4 (R G B, closeness), and 2, 1 and 1 more for own motion, alpha and
    reactive; what recurs holds count and closeness; the result its count. Both hold 3 or, with alpha, 4 planes of
    ``storage``. In bands the frame and its result are ``band_rows`` high. A ring holds ``frames_kept`` frames and one.
    """
    whole = Layout(width, height)
    band = Layout(width, band_rows) if band_rows else whole
    colour = (3 + steps.alpha) * int(np.dtype(storage_dtype(Build(storage=storage))).itemsize)
    frame = REAL * (4 + 2 * steps.own_motion + steps.alpha + steps.reactive)
    ring = REAL * kept_planes(steps) * (frames_kept + 1) if frames_kept else 0
    return (frame + colour + REAL) * band.plane + (colour + 2 * REAL) * whole.plane + ring * whole.plane
