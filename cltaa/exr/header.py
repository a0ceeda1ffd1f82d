"""The headers of an EXR file as bytes: attributes by name, part by part, held to limits before they are understood.

Read as the OpenEXR file layout defines them (https://openexr.com/en/latest/OpenEXRFileLayout.html). What passes,
OpenEXR understands in the same way: nothing stands twice, and no number is beyond its limit.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from cltaa.errors import DataError

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
                "sub-sampled channels are not read", path=path, channel=name, expected="every pixel",
                found=f"one in {x_sampling} x {y_sampling}", cure="write R G B, and every channel at full size",
            )  # fmt: skip
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
