"""What every twin reads of padded planes, and writes into them: twin of ``store_recurrent`` and ``extend_stored``.

The first is of ``taa/accumulate.h``, the second of ``schedule/edges.h``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cltaa.core.build import Build, Real, Record
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import Resolved
from cltaa.reference.colour import repaired_planes
from cltaa.reference.illumination import tests_light
from cltaa.reference.neighbourhood import Row, read_row
from cltaa.reference.real import Array, constant
from cltaa.reference.store import stored_history


def real_type(build: Build) -> Any:
    """NumPy type of the build's real."""
    return np.float64 if build.real is Real.DOUBLE else np.float32


def read_rows(
    current: Array, inverse_depth: Array, motion: Array | None, build: Build, layout: Layout, frame: Record
) -> tuple[Row, Row, Row]:
    """The rows above, at and below each pixel, from padded planes in the build's real."""
    real = real_type(build)
    colour = repaired_planes(current, layout).astype(real)
    near = inverse_depth.astype(real)
    moved = None if motion is None else motion.astype(real)
    above, centre, below = (read_row(colour, near, moved, dy, build, layout, frame) for dy in (-1, 0, 1))
    return above, centre, below


def store_resolved(
    resolved: Resolved, build: Build, layout: Layout, frame: Record, output: Array, output_count: Array
) -> None:
    """Write a resolved frame into padded planes, in the numbers of the build's storage."""
    target = layout.inside(output)
    for channel in range(3):
        target[channel] = stored_history(resolved.rgb[channel], build, layout, frame)
    if build.steps.alpha:
        alpha = np.where(resolved.alpha < constant("TINY", resolved.alpha), 0, resolved.alpha)
        target[3] = stored_history(alpha, build, layout, frame)
    layout.inside(output_count)[0] = resolved.count


def store_recurrent(
    resolved: Resolved, build: Build, layout: Layout, frame: Record, output: Array, output_count: Array
) -> None:
    """The same, and how light changes in the plane after the count's, where that is tested for."""
    store_resolved(resolved, build, layout, frame, output, output_count)
    if tests_light(build):
        layout.inside(output_count)[1] = resolved.change


def extend_stored(build: Build, layout: Layout, *planes: Array) -> None:
    """Repeat the edges of what a kernel stores, where it does so itself (``kernels/schedule/edges.h``)."""
    if build.extends:
        for stored in planes:
            layout.extend_edges(stored)
