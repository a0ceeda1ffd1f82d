"""Twin of ``repair.h``: texels outside the domain become the mean of their usable 3x3 neighbours."""

from __future__ import annotations

import numpy as np

from cltaa.constants import PAD_X, PAD_Y
from cltaa.memory.layout import Layout
from cltaa.parameters.build import Build, Real
from cltaa.reference.colour import Colour, colour_outside_domain, to_range
from cltaa.reference.real import Array, greater, number, quiet


@quiet
def repaired_planes(planes: Array, layout: Layout) -> Array:
    """Repaired copy of colour planes [3, rows, stride], halo included (the edge repeated).

    The sum runs over the 3x3 row by row and the mean is one division, as in the kernel.
    """
    bad = colour_outside_domain((planes[0], planes[1], planes[2]))
    repaired = planes.copy()
    rows, columns = np.nonzero(layout.inside(bad))
    if rows.size:
        rows, columns = rows + PAD_Y, columns + PAD_X
        zero = np.zeros_like(planes[:3, rows, columns])
        total, count = zero, zero[0]
        for j in (-1, 0, 1):
            for i in (-1, 0, 1):
                usable = ~bad[rows + j, columns + i]
                total = np.where(usable, total + planes[:3, rows + j, columns + i], total)
                count = np.where(usable, count + number(1.0, count), count)
        repaired[:3, rows, columns] = np.where(count > number(0.0, count), total / greater(count, 1.0), zero)
        layout.extend_edges(repaired)
    return repaired


def usable_colour(current: Array, build: Build, layout: Layout) -> Colour:
    """Each pixel's own colour [H, W], repaired where need be, in the range that everything is compared in."""
    real = np.float64 if build.real is Real.DOUBLE else np.float32
    r, g, b = (layout.inside(plane).astype(real) for plane in repaired_planes(current, layout)[:3])
    return to_range((r, g, b), build)
