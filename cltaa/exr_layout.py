"""What an EXR file says about itself before a pixel is decoded, and whether all of it is there.

The OpenEXR module gives no channel types without decoding, opens a truncated file without an error and allocates
whatever a header asks for. This reads the few bytes that tell, as the OpenEXR file layout defines them
(https://openexr.com/en/latest/OpenEXRFileLayout.html): magic number, version flags, attributes, table of chunks.
What it lets pass, OpenEXR understands in the same way: nothing stands twice, and no number is beyond its limit.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import DataError
from cltaa.file_content import file_size, open_regular

MAGIC = 20000630
TILED, DEEP, MULTI_PART = 1 << 9, 1 << 11, 1 << 12  # version flags
LARGEST_SIDE = 16384  # pixels; the largest image that the resolve promises
LARGEST_HEADER = 1 << 24  # bytes; object names and preview pictures in a header take a few million at most
FIRST_READ = 1 << 15  # bytes; holds nearly every header
MOST_ATTRIBUTES, MOST_CHANNELS = 4096, 1024  # renderers write some dozens of each
LONGEST_NAME = 255  # bytes, as the file layout says
PIXEL_TYPES = ("uint", "half", "float")  # in the order of their numbers in the file
PIXEL_BYTES = {"uint": 4, "half": 2, "float": 4}
# Name and scan lines a chunk, in the order of their numbers in the file.
COMPRESSIONS = (
    ("none", 1), ("rle", 1), ("zips", 1), ("zip", 16), ("piz", 32), ("pxr24", 16), ("b44", 32), ("b44a", 32),
    ("dwaa", 32), ("dwab", 256), ("htj2k256", 256), ("htj2k32", 32), ("lj2k", 256), ("zstd", 1),
)  # fmt: skip
COMPRESSION_NUMBERS = {name: number for number, (name, _) in enumerate(COMPRESSIONS)}
LOSSLESS = frozenset({"none", "rle", "zips", "zip", "piz", "htj2k256", "htj2k32", "zstd"})
# How many times larger than its chunk in the file a block of pixels can be, where the method has such a limit:
# deflate copies at most 258 bytes for 2 bits, and run lengths repeat a byte 128 times in 2 bytes.
LARGEST_RATIO = {"none": 1, "rle": 64, "zips": 1032, "zip": 1032}

Window = tuple[int, int, int, int]  # x and y of the first pixel, x and y of the last
Counts = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Layout:
    """Shape of one single-part EXR image: channel name -> "uint", "half" or "float", windows, compression."""

    path: Path
    channels: dict[str, str]
    data_window: Window
    display_window: Window
    compression: str

    @property
    def width(self) -> int:
        """Columns of the picture, which is the display window."""
        return self.display_window[2] - self.display_window[0] + 1

    @property
    def height(self) -> int:
        """Rows of the picture, which is the display window."""
        return self.display_window[3] - self.display_window[1] + 1

    @property
    def data_size(self) -> tuple[int, int]:
        """Columns and rows of the data window."""
        return self.data_window[2] - self.data_window[0] + 1, self.data_window[3] - self.data_window[1] + 1

    @property
    def bytes_a_pixel(self) -> int:
        """Bytes of all channels of a pixel, as decoded."""
        return sum(PIXEL_BYTES[kind] for kind in self.channels.values())

    @property
    def crop(self) -> tuple[slice, slice]:
        """Rows and columns of the data window that make up the picture (a renderer may draw more, never less)."""
        row, column = self.display_window[1] - self.data_window[1], self.display_window[0] - self.data_window[0]
        return slice(row, row + self.height), slice(column, column + self.width)


def read_layout(path: Path) -> Layout:
    """Read the layout of ``path`` and check that every chunk lies inside the file, in well under a millisecond.

    Raises InputMissing where there is no readable file, and DataError for what is no EXR file, is damaged or
    truncated, or is of a kind that is not read: deep, multi-part, sub-sampled, mip-mapped, larger than 16384.
    """
    with open_regular(path) as file:
        return parse_layout(path, file)


def parse_layout(path: Path, file: BinaryIO) -> Layout:
    """Do what ``read_layout`` does, for a file that is open; ``path`` is its name in messages."""
    try:
        return _parse(path, file)
    except (struct.error, IndexError, KeyError, ValueError) as error:
        raise DataError("the EXR header is damaged or cut off", path=path, cure="write the file again") from error


def _parse(path: Path, file: BinaryIO) -> Layout:
    start = _read_at(file, 0, FIRST_READ)
    if not start:
        raise DataError("the file is empty", path=path, expected="an EXR image", cure="write it again")
    if len(start) < 8 or struct.unpack_from("<I", start)[0] != MAGIC:
        raise DataError("this is not an EXR file", path=path, cure="convert it to OpenEXR first")
    (version,) = struct.unpack_from("<I", start, 4)
    for flag, kind in ((DEEP, "deep"), (MULTI_PART, "multi-part")):
        if version & flag:
            raise DataError(f"{kind} images are not read", path=path, cure="write a flat single-part EXR")
    try:
        attributes, table = _attributes(start)
    except IndexError:  # it may only be longer than what was read
        attributes, table = _attributes(_read_at(file, 0, LARGEST_HEADER))
    (codec,) = attributes["compression"]
    if codec >= len(COMPRESSIONS):
        raise DataError("unknown compression", path=path, found=codec, cure="write it with ZIP compression")
    layout = Layout(
        path=path,
        channels=_channels(path, attributes["channels"]),
        data_window=struct.unpack("<4i", attributes["dataWindow"]),
        display_window=struct.unpack("<4i", attributes["displayWindow"]),
        compression=COMPRESSIONS[codec][0],
    )
    _check_windows(layout)
    tiled = bool(version & TILED)
    pixels = _tile_sizes(layout, attributes["tiles"]) if tiled else _row_sizes(layout, COMPRESSIONS[codec][1])
    _check_chunks(layout, file, table, pixels, leader=20 if tiled else 8)
    return layout


def _read_at(file: BinaryIO, place: int, size: int) -> bytes:
    file.seek(place)
    return file.read(size)


def _attributes(header: bytes) -> tuple[dict[str, bytes], int]:
    """Raw attribute values by name, and the offset of the chunk table behind them; IndexError where it is cut off."""
    attributes: dict[str, bytes] = {}
    place = 8
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


def _channels(path: Path, value: bytes) -> dict[str, str]:
    channels: dict[str, str] = {}
    place = 0
    while value[place] != 0:
        name, place = _name(value, place)
        kind, _, x_sampling, y_sampling = struct.unpack_from("<4i", value, place)
        if (x_sampling, y_sampling) != (1, 1):
            found = f"one in {x_sampling} x {y_sampling}"
            raise DataError(
                "sub-sampled channels are not read", path=path, channel=name, expected="every pixel", found=found
            )
        if name in channels or kind < 0 or len(channels) == MOST_CHANNELS:
            raise ValueError("channel twice, of no type, or one too many")
        channels[name] = PIXEL_TYPES[kind]
        place += 16
    return channels


def _check_windows(layout: Layout) -> None:
    for name, window in (("data window", layout.data_window), ("display window", layout.display_window)):
        width, height = window[2] - window[0] + 1, window[3] - window[1] + 1
        if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
            expected = f"1 to {LARGEST_SIDE} pixels a side"
            raise DataError(f"impossible {name}", path=layout.path, expected=expected, found=f"{width} x {height}")
    data, display = layout.data_window, layout.display_window
    if data[0] > display[0] or data[1] > display[1] or data[2] < display[2] or data[3] < display[3]:
        raise DataError(
            "the data window does not cover the display window",
            path=layout.path, expected=f"at least {display}", found=data, cure="render the whole picture",
        )  # fmt: skip


def _row_sizes(layout: Layout, rows_per_chunk: int) -> Counts:
    """Pixels of each chunk of scan lines."""
    columns, rows = layout.data_size
    starts = np.arange(0, rows, rows_per_chunk)
    return np.minimum(rows_per_chunk, rows - starts) * columns


def _tile_sizes(layout: Layout, value: bytes) -> Counts:
    """Pixels of each tile; the table of chunks may hold them in any order, so that the smallest stands for all."""
    width, height, mode = struct.unpack("<IIB", value)
    if mode & 0xF:
        raise DataError("mip-mapped images are not read", path=layout.path, cure="write scan lines")
    if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
        raise ValueError("tiles of no size, or larger than any image")
    columns, rows = layout.data_size
    smallest = ((columns - 1) % width + 1) * ((rows - 1) % height + 1)
    return np.full(-(-columns // width) * -(-rows // height), smallest)


def _check_chunks(layout: Layout, file: BinaryIO, table: int, pixels: Counts, leader: int) -> None:
    """Check that every chunk begins behind the table, ends inside the file and can hold its pixels.

    The size of a chunk ends its ``leader`` bytes. One that is smaller than its compression allows cannot be decoded.
    """
    length, start = file_size(file), table + 8 * len(pixels)
    if start > length:
        raise DataError("the file is truncated inside its table of chunks", path=layout.path, cure="write it again")
    offsets = np.frombuffer(_read_at(file, table, 8 * len(pixels)), dtype="<u8")
    fits = bool((offsets >= start).all() and (offsets <= length - leader).all())
    if fits:
        sizes = np.array([struct.unpack_from("<i", _read_at(file, int(place) + leader - 4, 4))[0] for place in offsets])
        fits = bool((sizes >= 0).all() and (offsets + sizes.astype("<u8") <= length - leader).all())
    if not fits:
        raise DataError("the file is truncated or was never finished", path=layout.path, cure="write it again")
    ratio = LARGEST_RATIO.get(layout.compression)
    if ratio is not None and (sizes * ratio < pixels * layout.bytes_a_pixel).any():
        raise DataError("a chunk is too small for its pixels", path=layout.path, cure="write it again")
