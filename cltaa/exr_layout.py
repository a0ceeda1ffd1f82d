"""What an EXR file says about itself before a pixel is decoded, and whether all of it is there.

The OpenEXR module gives no channel types without decoding, opens a truncated file without an error and allocates
whatever a header asks for. This reads the few bytes that tell, as the OpenEXR file layout defines them
(https://openexr.com/en/latest/OpenEXRFileLayout.html): magic number, version flags, attributes, table of chunks.
"""

from __future__ import annotations

import mmap
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cltaa.errors import DataError, InputMissing, StorageError

MAGIC = 20000630
TILED, DEEP, MULTI_PART = 1 << 9, 1 << 11, 1 << 12  # version flags
LARGEST_SIDE = 16384  # pixels; the largest image that the resolve promises
PIXEL_TYPES = ("uint", "half", "float")  # in the order of their numbers in the file
# Name and scan lines a chunk, in the order of their numbers in the file.
COMPRESSIONS = (
    ("none", 1), ("rle", 1), ("zips", 1), ("zip", 16), ("piz", 32), ("pxr24", 16), ("b44", 32), ("b44a", 32),
    ("dwaa", 32), ("dwab", 256), ("htj2k256", 256), ("htj2k32", 32), ("lj2k", 256), ("zstd", 1),
)  # fmt: skip
COMPRESSION_NUMBERS = {name: number for number, (name, _) in enumerate(COMPRESSIONS)}
LOSSLESS = frozenset({"none", "rle", "zips", "zip", "piz", "htj2k256", "htj2k32", "zstd"})

Window = tuple[int, int, int, int]  # x and y of the first pixel, x and y of the last


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
    def crop(self) -> tuple[slice, slice]:
        """Rows and columns of the data window that make up the picture (a renderer may draw more, never less)."""
        row, column = self.display_window[1] - self.data_window[1], self.display_window[0] - self.data_window[0]
        return slice(row, row + self.height), slice(column, column + self.width)


def read_layout(path: Path) -> Layout:
    """Read the layout of ``path`` and check that every chunk lies inside the file, in well under a millisecond.

    Raises InputMissing where there is no readable file, and DataError for what is no EXR file, is damaged or
    truncated, or is of a kind that is not read: deep, multi-part, sub-sampled, mip-mapped, larger than 16384.
    """
    with _mapped(path) as content:
        try:
            return _parse(path, content)
        except (struct.error, IndexError, KeyError, ValueError) as error:
            raise DataError("the EXR header is damaged or cut off", path=path, cure="write the file again") from error


def _mapped(path: Path) -> mmap.mmap:
    try:
        if path.is_dir():
            raise DataError("this is a folder", path=path, expected="an EXR file")
        with path.open("rb") as file:
            if path.stat().st_size == 0:
                raise DataError("the file is empty", path=path, expected="an EXR image", cure="write it again")
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except FileNotFoundError as error:
        raise InputMissing("the file is missing", path=path, cure="check the name") from error
    except PermissionError as error:
        raise InputMissing("the file cannot be read: permission denied", path=path) from error
    except (OSError, ValueError) as error:
        raise StorageError(f"reading failed: {error}", path=path) from error


def _parse(path: Path, content: mmap.mmap) -> Layout:
    if len(content) < 8 or struct.unpack_from("<I", content)[0] != MAGIC:
        raise DataError("this is not an EXR file", path=path, cure="convert it to OpenEXR first")
    (version,) = struct.unpack_from("<I", content, 4)
    for flag, kind in ((DEEP, "deep"), (MULTI_PART, "multi-part")):
        if version & flag:
            raise DataError(f"{kind} images are not read", path=path, cure="write a flat single-part EXR")
    attributes, table = _attributes(content)
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
    count = _tile_count(layout, attributes["tiles"]) if tiled else _row_count(layout, COMPRESSIONS[codec][1])
    _check_chunks(path, content, table, count, leader=20 if tiled else 8)
    return layout


def _attributes(content: mmap.mmap) -> tuple[dict[str, bytes], int]:
    """Raw attribute values by name, and the offset of the chunk table behind them."""
    attributes: dict[str, bytes] = {}
    place = 8
    while content[place] != 0:
        end_of_name = content.find(b"\0", place)
        end_of_type = content.find(b"\0", end_of_name + 1)
        (size,) = struct.unpack_from("<i", content, end_of_type + 1)
        start = end_of_type + 5
        if min(end_of_name, end_of_type, size) < 0 or start + size >= len(content):
            raise IndexError("attribute reaches beyond the file")
        attributes[content[place:end_of_name].decode()] = content[start : start + size]
        place = start + size
    return attributes, place + 1


def _channels(path: Path, value: bytes) -> dict[str, str]:
    channels: dict[str, str] = {}
    place = 0
    while value[place] != 0:
        end = value.index(b"\0", place)
        name = value[place:end].decode()
        kind, _, x_sampling, y_sampling = struct.unpack_from("<4i", value, end + 1)
        if (x_sampling, y_sampling) != (1, 1):
            found = f"one in {x_sampling} x {y_sampling}"
            raise DataError(
                "sub-sampled channels are not read", path=path, channel=name, expected="every pixel", found=found
            )
        channels[name] = PIXEL_TYPES[kind]
        place = end + 17
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


def _row_count(layout: Layout, rows_per_chunk: int) -> int:
    rows = layout.data_window[3] - layout.data_window[1] + 1
    return -(-rows // rows_per_chunk)


def _tile_count(layout: Layout, value: bytes) -> int:
    width, height, mode = struct.unpack("<IIB", value)
    if mode & 0xF:
        raise DataError("mip-mapped images are not read", path=layout.path, cure="write scan lines")
    window = layout.data_window
    columns, rows = window[2] - window[0] + 1, window[3] - window[1] + 1
    if width == 0 or height == 0:
        raise IndexError("tiles of no size")
    return int(-(-columns // width) * -(-rows // height))


def _check_chunks(path: Path, content: mmap.mmap, table: int, count: int, leader: int) -> None:
    """Check that every chunk begins behind the table and ends inside the file; its size ends its ``leader`` bytes."""
    start = table + 8 * count
    if start > len(content):
        raise DataError("the file is truncated inside its table of chunks", path=path, cure="write it again")
    offsets = np.frombuffer(content[table:start], dtype="<u8")
    sizes_fit = bool((offsets >= start).all() and (offsets <= len(content) - leader).all())
    if sizes_fit:
        sizes = [struct.unpack_from("<i", content, int(offset) + leader - 4)[0] for offset in offsets]
        sizes_fit = min(sizes) >= 0 and bool((offsets + np.array(sizes, "<u8") <= len(content) - leader).all())
    if not sizes_fit:
        raise DataError("the file is truncated or was never finished", path=path, cure="write it again")
