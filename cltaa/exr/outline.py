"""What an EXR file says about itself before a pixel is decoded, and whether all of it is there.

The OpenEXR module gives no channel types without decoding, opens a truncated file without an error and allocates
whatever a header asks for. This reads the few bytes that tell, as the OpenEXR file layout defines them
(https://openexr.com/en/latest/OpenEXRFileLayout.html): magic number, version flags, attributes, table of chunks.
What it lets pass, OpenEXR understands in the same way: nothing stands twice, and no number is beyond its limit.
"""

from __future__ import annotations

import struct
from functools import partial
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from cltaa.errors import DataError
from cltaa.exr.chunks import Table, check_chunks
from cltaa.exr.header import LARGEST_SIDE, MULTI_PART, TILED, Header, damaged, read_at, read_channels, read_headers
from cltaa.exr.layout import COMPRESSIONS, Layout, shared_window
from cltaa.exr.tiles import Counts, tile_sizes
from cltaa.files.content import Look, file_size, open_regular


def read_layout(path: Path) -> Layout:
    """Read the layout of ``path`` and check that every chunk lies inside the file, in well under a millisecond.

    Raises InputMissing where there is no readable file, and DataError for what is no EXR file, is damaged or
    truncated, or is of a kind that is not read: deep, multi-part, sub-sampled, larger than 16384.
    """
    with open_regular(path) as file:
        return parse_layout(path, file)


def parse_layout(path: Path, file: BinaryIO) -> Layout:
    """Do what ``read_layout`` does, for a file that is open; ``path`` is its name in messages."""
    outline = read_outline(path, file)
    layout = outline.layout
    outline.check_chunks(partial(read_at, file), file_size(file))
    return layout


def parse_parts(path: Path, file: BinaryIO) -> tuple[Layout, ...]:
    """Layouts of all parts of an open file, checked as ``read_layout`` does, and against each other."""
    outline = read_outline(path, file)
    outline.check_chunks(partial(read_at, file), file_size(file))
    return outline.parts


class Outline(NamedTuple):
    """What the headers of a file say of its parts, and where the tables of their chunks must be."""

    path: Path
    parts: tuple[Layout, ...]
    tables: list[Table]

    @property
    def layout(self) -> Layout:
        """That of the only part; raises DataError for a file of many."""
        if self.parts[0].part is not None:
            raise DataError("multi-part images are not read", path=self.path, cure="write a flat single-part EXR")
        return self.parts[0]

    def check_chunks(self, look: Look, length: int) -> None:
        """Check that every chunk lies inside the file of ``length`` bytes and can hold its pixels; raises DataError.

        Each chunk is looked at, which in a file is a turn with the interpreter for each.
        """
        with damaged(self.path):
            for table in self.tables:
                check_chunks(table, look, length)


def read_outline(path: Path, file: BinaryIO) -> Outline:
    """Parse the headers of an open file without a look at its chunks; raises DataError."""
    with damaged(path):
        version, headers, place = read_headers(path, file)
        many = bool(version & MULTI_PART)
        tiled = [header["type"] == b"tiledimage" if many else bool(version & TILED) for header in headers]
        parts = tuple(_layout(path, *its, many=many) for its in zip(headers, tiled, strict=True))
        if len({part.part for part in parts}) < len(parts) or not all(
            (part.part or "").isprintable() for part in parts
        ):
            raise ValueError("parts of one name, or of a name that could harm a terminal")
        if len({part.display_window for part in parts}) > 1:
            raise DataError("the parts do not make one picture", path=path, cure="write them with one display window")
        picture = shared_window(parts)
        for part in parts:
            part.part_of(picture)
        chunks = [_chunk_sizes(*its) for its in zip(parts, headers, tiled, strict=True)]
        behind, tables = place + 8 * sum(len(sizes) for sizes in chunks), list[Table]()
        for part, in_tiles, sizes in zip(parts, tiled, chunks, strict=True):
            # A chunk begins with its part (if there are many), its place (y, or four numbers) and its size.
            leader = 4 * many + (20 if in_tiles else 8)
            tables.append(Table(path, place, sizes, part.bytes_a_pixel, part.compression, leader, behind))
            place += 8 * len(sizes)
    return Outline(path, parts, tables)


def _layout(path: Path, header: Header, tiled: bool, *, many: bool) -> Layout:
    (codec,) = header["compression"]
    if codec >= len(COMPRESSIONS):
        raise DataError("unknown compression", path=path, found=codec, cure="write it with ZIP compression")
    if header.get("type", b"").startswith(b"deep"):
        raise DataError("deep images are not read", path=path, cure="write a flat EXR")
    layout = Layout(
        path=path,
        channels=read_channels(path, header["channels"]),
        data_window=struct.unpack("<4i", header["dataWindow"]),
        display_window=struct.unpack("<4i", header["displayWindow"]),
        compression=COMPRESSIONS[codec][0],
        part=header["name"].decode() if many else None,
        tile=struct.unpack_from("<II", header["tiles"]) if tiled else None,
    )
    _check_windows(layout)
    return layout


def _chunk_sizes(layout: Layout, header: Header, tiled: bool) -> Counts:
    """Pixels of each chunk of a part."""
    rows = COMPRESSIONS[header["compression"][0]][1]
    sizes = tile_sizes(layout.width, layout.height, header["tiles"]) if tiled else _row_sizes(layout, rows)
    if layout.part is not None and struct.unpack("<i", header["chunkCount"]) != (len(sizes),):
        raise ValueError("not as many chunks as the windows ask for")
    return sizes


def _check_windows(layout: Layout) -> None:
    for name, window in (("data window", layout.data_window), ("display window", layout.display_window)):
        width, height = window[2] - window[0] + 1, window[3] - window[1] + 1
        if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
            expected = f"1 to {LARGEST_SIDE} pixels a side"
            raise DataError(f"impossible {name}", path=layout.path, expected=expected, found=f"{width} x {height}")
    data, display = layout.data_window, layout.display_window
    if data[0] > display[2] or data[1] > display[3] or data[2] < display[0] or data[3] < display[1]:
        raise DataError(
            "the data window lies outside of the display window", path=layout.path, expected=f"some of {display}",
            found=data, cure="render a region of the picture, or the whole",
        )  # fmt: skip


def _row_sizes(layout: Layout, rows_per_chunk: int) -> Counts:
    """Pixels of each chunk of scan lines."""
    starts = np.arange(0, layout.height, rows_per_chunk)
    return np.minimum(rows_per_chunk, layout.height - starts) * layout.width
