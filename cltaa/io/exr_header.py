"""EXR headers as bytes, and whether all that they promise is in the file, before a pixel is decoded.

Read as the OpenEXR file layout defines them (https://openexr.com/en/latest/OpenEXRFileLayout.html). What passes,
OpenEXR understands in the same way: nothing stands twice, and no number is beyond its limit.

The OpenEXR module gives no channel types without decoding, opens a truncated file without an error and allocates
whatever a header asks for. This reads the few bytes that tell, as the OpenEXR file layout defines them
(https://openexr.com/en/latest/OpenEXRFileLayout.html): magic number, version flags, attributes, table of chunks.
What it lets pass, OpenEXR understands in the same way: nothing stands twice, and no number is beyond its limit.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import DataError
from cltaa.io.content import ReadAt, file_size, open_regular
from cltaa.io.exr_layout import COMPRESSIONS, Layout, shared_window

MAGIC = 20000630
TILED, DEEP, MULTI_PART = 1 << 9, 1 << 11, 1 << 12  # version flags
LARGEST_SIDE = 16384  # pixels; the largest image that the resolve promises
LARGEST_HEADER = 1 << 24  # bytes; object names and preview pictures in a header take a few million at most
FIRST_READ = 1 << 15  # bytes; holds nearly every header
MOST_PARTS, MOST_ATTRIBUTES, MOST_CHANNELS = 256, 4096, 1024  # renderers write some dozens of each
LONGEST_NAME = 255  # bytes, as the file layout says
PIXEL_TYPES = ("uint", "half", "float")  # in the order of their numbers in the file

Header = dict[str, bytes]


def read_headers(path: Path, file: BinaryIO) -> tuple[int, list[Header], int]:
    """Return the version flags, the raw attributes of each part, and the offset of the first table of chunks.

    Raises DataError for what is no EXR file or deep, and ValueError or IndexError for what is damaged or cut off.
    """
    start = read_at(file, 0, FIRST_READ)
    if not start:
        raise DataError("the file is empty", path=path, expected="an EXR image", cure="write it again")
    if len(start) < 8 or struct.unpack_from("<I", start)[0] != MAGIC:
        raise DataError("this is not an EXR file", path=path, cure="convert it to OpenEXR first")
    (version,) = struct.unpack_from("<I", start, 4)
    if version & DEEP:
        raise DataError("deep images are not read", path=path, cure="write a flat EXR")
    try:
        return version, *_headers(start, many=bool(version & MULTI_PART))
    except IndexError:  # it may only be longer than what was read
        return version, *_headers(read_at(file, 0, LARGEST_HEADER), many=bool(version & MULTI_PART))


def read_channels(path: Path, value: bytes) -> dict[str, str]:
    """Types of channels by name, out of the attribute ``channels``; DataError where some are not for every pixel."""
    channels: dict[str, str] = {}
    place = 0
    while value[place] != 0:
        name, place = _name(value, place)
        kind, _, x_sampling, y_sampling = struct.unpack_from("<4i", value, place)
        if (x_sampling, y_sampling) != (1, 1):
            raise DataError(
                "sub-sampled channels are not read",
                path=path,
                channel=name,
                expected="every pixel",
                found=f"one in {x_sampling} x {y_sampling}",
                cure="write R G B, and every channel at full size",
            )
        if name in channels or kind < 0 or len(channels) == MOST_CHANNELS:
            raise ValueError("channel twice, of no type, or one too many")
        channels[name] = PIXEL_TYPES[kind]
        place += 16
    return channels


def places_of(content: bytes) -> dict[str, slice]:
    """Where the value of each attribute stands in a file of one part; raises IndexError where it is cut off."""
    places: dict[str, slice] = {}
    place = 8
    while content[place] != 0:
        name, place = _name(content, place)
        _, place = _name(content, place)  # of its type
        start = place + 4
        place = start + struct.unpack_from("<i", content, place)[0]
        places[name] = slice(start, place)
    return places


@contextmanager
def damaged(path: Path) -> Iterator[None]:
    """Raise DataError for what parsing bytes raises that are damaged or cut off."""
    try:
        yield
    except (struct.error, IndexError, KeyError, ValueError) as error:
        raise DataError("the EXR header is damaged or cut off", path=path, cure="write the file again") from error


def read_at(file: BinaryIO, place: int, size: int) -> bytes:
    """Read ``size`` bytes from ``place`` on, fewer where the file ends."""
    file.seek(place)
    return file.read(size)


def _headers(content: bytes, *, many: bool) -> tuple[list[Header], int]:
    """One header, or all up to an empty one, and the place behind them."""
    header, place = _attributes(content, 8)
    headers = [header]
    while many and content[place] != 0:
        if len(headers) == MOST_PARTS:
            raise ValueError("one part too many")
        header, place = _attributes(content, place)
        headers.append(header)
    return headers, place + many


def _attributes(header: bytes, place: int) -> tuple[Header, int]:
    """Raw attribute values by name from ``place`` on, and the place behind them; IndexError where it is cut off."""
    attributes: Header = {}
    while header[place] != 0:
        name, place = _name(header, place)
        _, place = _name(header, place)  # of its type
        if place + 4 > len(header):
            raise IndexError("attribute without a size")
        (size,) = struct.unpack_from("<i", header, place)
        start, place = place + 4, place + 4 + size
        if size < 0 or name in attributes or len(attributes) == MOST_ATTRIBUTES:
            raise ValueError("attribute of a negative size, twice, or one too many")
        if place >= len(header):
            raise IndexError("attribute reaches beyond the file")
        attributes[name] = header[start:place]
    return attributes, place + 1


def _name(content: bytes, place: int) -> tuple[str, int]:
    """The name that begins at ``place``, and the place behind its end; ValueError for what could harm a terminal."""
    end = content.find(b"\0", place, place + LONGEST_NAME + 1)
    if end < 0 and len(content) <= place + LONGEST_NAME:
        raise IndexError("name reaches beyond the file")
    name = content[place:end].decode()
    if end <= place or not name.isprintable():
        raise ValueError("no name of an attribute or a channel")
    return name, end + 1


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


# How many times larger than its chunk in the file a block of pixels can be, where the method has such a limit:
# deflate copies at most 258 bytes for 2 bits, and run lengths repeat a byte 128 times in 2 bytes.
LARGEST_RATIO = {"none": 1, "rle": 64, "zips": 1032, "zip": 1032}


class Table(NamedTuple):
    """A part's table of chunks: where it stands and what it has to say."""

    path: Path
    place: int
    pixels: Counts  # of each chunk
    bytes_a_pixel: int
    compression: str
    leader: int  # bytes that each chunk begins with
    behind: int  # where the first chunk can be: behind all tables


def check_chunks(table: Table, read_at: ReadAt, length: int) -> None:
    """Check that every chunk begins behind all tables, ends inside the file and can hold its pixels.

    The size of a chunk ends its ``leader`` bytes. One that is smaller than its compression allows cannot be decoded.
    ``read_at`` reads bytes of the file, which has ``length`` of them. Raises DataError, and struct.error or ValueError
    where bytes are missing.
    """
    path, place, pixels, bytes_a_pixel, compression, leader, behind = table
    if behind > length:
        raise DataError("the file is truncated inside its table of chunks", path=path, cure="write it again")
    offsets = np.frombuffer(read_at(place, 8 * len(pixels)), dtype="<u8")
    fits = bool((offsets >= behind).all() and (offsets <= length - leader).all())
    if fits:
        ends = (int(offset) + leader for offset in offsets)
        sizes = np.array([struct.unpack_from("<i", read_at(end - 4, 4))[0] for end in ends])
        fits = bool((sizes >= 0).all() and (offsets + sizes.astype("<u8") <= length - leader).all())
    if not fits:
        raise DataError("the file is truncated or was never finished", path=path, cure="write it again")
    ratio = LARGEST_RATIO.get(compression)
    if ratio is not None and (sizes * ratio < pixels * bytes_a_pixel).any():
        raise DataError("a chunk is too small for its pixels", path=path, cure="write it again")


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

    def check_chunks(self, read_at: ReadAt, length: int) -> None:
        """Check that every chunk lies inside the file of ``length`` bytes and can hold its pixels; raises DataError.

        Each chunk is looked at, which in a file is an acquisition of the GIL for each.
        """
        with damaged(self.path):
            for table in self.tables:
                check_chunks(table, read_at, length)


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
            "the data window lies outside of the display window",
            path=layout.path,
            expected=f"some of {display}",
            found=data,
            cure="render a region of the picture, or the whole",
        )


def _row_sizes(layout: Layout, rows_per_chunk: int) -> Counts:
    """Pixels of each chunk of scan lines."""
    starts = np.arange(0, layout.height, rows_per_chunk)
    return np.minimum(rows_per_chunk, layout.height - starts) * layout.width
