"""How many tiles a tiled EXR image has, over all of its levels, and how small the smallest is."""

from __future__ import annotations

import struct
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from cltaa.exr.header import LARGEST_SIDE

ONE_LEVEL, MIP_MAP, RIP_MAP = range(3)  # modes, as the file layout numbers them

Counts = NDArray[np.int64]


def tile_sizes(columns: int, rows: int, value: bytes) -> Counts:
    """Pixels of each tile of all levels; the table of chunks may hold them in any order: the smallest stands for all.

    ``value`` is the attribute ``tiles``. Smaller levels of a mip-mapped image are not read, but their tiles stand in
    the table too. Raises ValueError for tiles or levels that there are not.
    """
    width, height, mode = struct.unpack("<IIB", value)
    if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
        raise ValueError("tiles of no size, or larger than any image")
    levels, up = mode & 0xF, bool(mode >> 4)
    sides = (_level_sides(columns, up), width), (_level_sides(rows, up), height)
    across, down = ([-(-side // tile) for side in of_levels] for of_levels, tile in sides)
    if levels == ONE_LEVEL:
        count = across[0] * down[0]
    elif levels == MIP_MAP:
        # The shorter side stays at 1 pixel, one tile, while the other gets there.
        count = sum(one * other for one, other in zip_longest(across, down, fillvalue=1))
    elif levels == RIP_MAP:
        count = sum(across) * sum(down)
    else:
        raise ValueError("no such mode of levels")
    smallest = ((columns - 1) % width + 1) * ((rows - 1) % height + 1) if levels == ONE_LEVEL else 1
    return np.broadcast_to(np.int64(smallest), count)


def _level_sides(side: int, up: bool) -> list[int]:
    """Pixels of a side in each level: halved and rounded down, or ``up``, until 1 is left."""
    sides = [side]
    while sides[-1] > 1:
        sides.append((sides[-1] + up) // 2)
    return sides
