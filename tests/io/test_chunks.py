"""How small a chunk of an EXR file may be for its pixels, and how small its smallest tile is."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from cltaa.errors import DataError
from cltaa.io.exr_header import ONE_LEVEL, Table, tile_sizes
from cltaa.io.exr_layout import Layout

SIZE = 10  # bytes of the chunk


@pytest.mark.parametrize(("compression", "ratio"), [("none", 1), ("rle", 64), ("zips", 1032), ("zip", 1032)])
def test_a_chunk_is_as_large_as_its_compression_allows(compression: str, ratio: int) -> None:
    content = struct.pack("<qii", 8, 0, SIZE) + bytes(SIZE)  # the table of one chunk, its line and its size

    def check(pixels: int) -> None:
        layout = Layout(Path("a.exr"), {"Y": "half"}, (0, 0, 0, 0), (0, 0, 0, 0), compression)
        table = Table(0, 0, layout, np.array([pixels]), leader=8)
        table.check_chunks(lambda place, length: content[place : place + length], len(content), behind=8)

    check(ratio * SIZE // 2)
    with pytest.raises(DataError, match="too small for its pixels"):
        check(ratio * SIZE // 2 + 1)


@pytest.mark.parametrize(("columns", "rows", "smallest"), [(64, 32, 32 * 16), (65, 33, 1), (63, 31, 31 * 15)])
def test_the_smallest_tile_is_the_last(columns: int, rows: int, smallest: int) -> None:
    assert tile_sizes(Path(), columns, rows, struct.pack("<IIB", 32, 16, ONE_LEVEL)).min() == smallest
