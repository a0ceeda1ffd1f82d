"""Twin of ``repair.h``: texels outside the domain become the mean of their usable 3x3 neighbours."""

from __future__ import annotations

import numpy as np

from cltaa.constants import PAD_X, PAD_Y
from cltaa.layout import Layout
from cltaa.reference.colour import colour_outside_domain
from cltaa.reference.real import Array


def repaired_planes(planes: Array, layout: Layout) -> Array:
    """Repaired copy of colour planes [3, rows, stride], halo included (the edge repeated).

    The sum runs over the 3x3 row by row and the mean is one division, as in the kernel.
    """
    bad = colour_outside_domain((planes[0], planes[1], planes[2]))
    repaired = planes.copy()
    if bad.any():
        for y, x in np.argwhere(layout.inside(bad)):
            row, column = y + PAD_Y, x + PAD_X
            window = np.s_[row - 1 : row + 2, column - 1 : column + 2]
            usable = ~bad[window]
            for channel in range(3):
                total = planes.dtype.type(0.0)
                for texel in planes[channel][window][usable]:
                    total = total + texel
                count = planes.dtype.type(max(int(usable.sum()), 1))
                repaired[channel, row, column] = total / count
        layout.extend_edges(repaired)
    return repaired
