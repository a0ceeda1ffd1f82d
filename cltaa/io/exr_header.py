"""EXR headers as bytes, and a check that the file holds all that they promise, before a pixel is decoded.

The OpenEXR module gives no channel types without decoding, opens a truncated file without an error and allocates
whatever a header asks for. This module reads the few bytes needed, as the OpenEXR file layout defines them
(https://openexr.com/en/latest/OpenEXRFileLayout.html): magic number, version flags, attributes, table of chunks.
OpenEXR interprets all that it accepts in the same way: no duplicates, and numbers within their limits.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import BinaryIO, NamedTuple
from unicodedata import category

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import DataError
from cltaa.io.content import ReadAt, file_size, open_regular
from cltaa.io.exr_layout import COMPRESSIONS, OTHER_TOOLS, Layout

MAGIC = 20000630
TILED, DEEP, MULTI_PART = 1 << 9, 1 << 11, 1 << 12  # version flags
LARGEST_SIDE = 16384  # pixels; the largest image that the resolve promises
LARGEST_HEADER = 1 << 24  # bytes; object names and preview pictures in a header take a few million at most
FIRST_READ = 1 << 15  # bytes; holds nearly every header
MOST_PARTS, MOST_ATTRIBUTES, MOST_CHANNELS = 256, 4096, 1024  # renderers write some dozens of each
JOINERS = "\u200c\u200d"  # within Persian and Indic words, and signs of several
LONGEST_NAME = 255  # bytes, by the file layout
UNKNOWN = ord("?")  # in place of the first letter of a type, makes it one that nobody knows
ODD = ("rational", "string", "stringvector", "deepImageState")  # types whose values may need that
PIXEL_TYPES = ("uint", "half", "float")  # in the order of their numbers in the file

Header = dict[str, bytes]  # raw values of attributes by name


def read_headers(path: Path, file: BinaryIO) -> tuple[int, list[Header], list[int], int]:
    """Return the version flags, the raw attributes of each part, the places of the types of all attributes whose values
    OpenEXR's Python module cannot represent, and the offset of the first table of chunks.

    Such values are valid in a file. Of a type that nobody knows the module passes on the bytes.

    Raises ValueError or IndexError for a damaged or truncated file, DataError for one that is not EXR or is deep.
    """
    start = read_at(file, 0, FIRST_READ)
    if not start:
        raise DataError("the file is empty", path=path, expected="an EXR image", cure="write it again")
    if len(start) < 8 or struct.unpack_from("<I", start)[0] != MAGIC:
        raise DataError("this is not an EXR file", path=path, cure="convert it to OpenEXR first")
    (version,) = struct.unpack_from("<I", start, 4)
    if version & DEEP and not version & MULTI_PART:  # in a file of several parts some may be flat
        raise _deep(path)
    try:
        return version, *_headers(path, start, many=bool(version & MULTI_PART))
    except IndexError:  # the header may only be longer than the first read
        return version, *_headers(path, read_at(file, 0, LARGEST_HEADER), many=bool(version & MULTI_PART))


def read_channels(path: Path, value: bytes) -> dict[str, str]:
    """Return the types of channels by name from the attribute ``channels``; DataError for sub-sampled or too many."""
    channels: dict[str, str] = {}
    place = 0
    while value[place] != 0:
        name, place = _name(value, place)
        kind, _, x_sampling, y_sampling = struct.unpack_from("<4i", value, place)
        if (x_sampling, y_sampling) != (1, 1):
            what, cure = "sub-sampled channels are not read", "write R G B, and every channel at full size"
            found = f"one in {x_sampling} x {y_sampling}"
            raise DataError(what, path=path, channel=name, expected="every pixel", found=found, cure=cure)
        if name in channels or kind < 0:
            raise ValueError("channel twice, or of no type")
        channels[name] = PIXEL_TYPES[kind]
        place += 16
    if len(channels) > MOST_CHANNELS:
        expected, cure = f"at most {MOST_CHANNELS}", "write fewer, or in several parts"
        raise DataError("too many channels", path=path, expected=expected, found=len(channels), cure=cure)
    return channels


def _deep(path: Path) -> DataError:
    return DataError("deep images are not read", path=path, cure="write a flat EXR")


@contextmanager
def damaged(path: Path) -> Iterator[None]:
    """Raise DataError for the errors of parsing bytes that are damaged or truncated."""
    try:
        yield
    except UnicodeDecodeError as error:  # valid before OpenEXR 3; a damaged file can look so, too
        what, cure = "a name in the EXR header is not UTF-8", "rename the channel, part or attribute, or write it again"
        raise DataError(what, path=path, found=repr(error.object[:LONGEST_NAME])[1:], cure=cure) from error
    except (struct.error, IndexError, KeyError, ValueError) as error:
        raise DataError("the EXR header is damaged or cut off", path=path, cure="write the file again") from error


def read_at(file: BinaryIO, place: int, size: int) -> bytes:
    """Read ``size`` bytes from ``place`` on, fewer where the file ends."""
    file.seek(place)
    return file.read(size)


def _headers(path: Path, content: bytes, *, many: bool) -> tuple[list[Header], list[int], int]:
    """Return one header, or all up to an empty one, the places of odd types, and the place after all."""
    headers, odd, place = list[Header](), list[int](), 8
    while not headers or (many and content[place] != 0):
        if len(headers) == MOST_PARTS:
            raise DataError("too many parts", path=path, expected=f"at most {MOST_PARTS}")
        places, place = places_of(path, content, place)
        headers.append({name: content[its.value] for name, its in places.items()})
        odd += [its.kind_at for its in places.values() if _is_odd(its.kind, content[its.value])]
    return headers, odd, place + many


class Placed(NamedTuple):
    """An attribute in a header: where its type lies, the type's name, and where the value lies."""

    kind_at: int
    kind: str
    value: slice


def places_of(path: Path, header: bytes, place: int = 8) -> tuple[dict[str, Placed], int]:
    """Return the place of each attribute from ``place`` on, and the place after all; raises IndexError where it is
    truncated, ValueError and DataError where it is damaged or too much."""
    attributes: dict[str, Placed] = {}
    while header[place] != 0:
        name, kind_at = _name(header, place)
        kind, place = _name(header, kind_at)
        if place + 4 > len(header):
            raise IndexError("attribute without a size")
        (size,) = struct.unpack_from("<i", header, place)
        start, place = place + 4, place + 4 + size
        if size < 0 or name in attributes:
            raise ValueError("attribute of a negative size, or twice")
        if len(attributes) == MOST_ATTRIBUTES:
            raise DataError("too many attributes", path=path, expected=f"at most {MOST_ATTRIBUTES}")
        if place >= len(header):
            raise IndexError("attribute reaches beyond the file")
        attributes[name] = Placed(kind_at, kind, slice(start, place))
    return attributes, place + 1


def hidden_types(path: Path, header: bytes) -> dict[int, bytes]:
    """Return the places of types of one part that a reader made ``UNKNOWN``, and the first letter of each."""
    hidden = {chr(UNKNOWN) + kind[1:]: kind[:1].encode() for kind in ODD}
    return {its.kind_at: hidden[its.kind] for its in places_of(path, header)[0].values() if its.kind in hidden}


def _is_odd(kind: str, value: bytes) -> bool:
    if kind == "rational":  # numerator / 0 is infinity
        return value[4:] == bytes(4)
    try:
        for text in _texts(kind, value):  # of any encoding before OpenEXR 3
            text.decode()
    except UnicodeDecodeError:
        return True
    return kind == "deepImageState"


def _texts(kind: str, value: bytes) -> Iterator[bytes]:
    """Yield the texts in the ``value`` of an attribute; each of a vector has its length before it."""
    if kind == "string":
        yield value
    while kind == "stringvector" and len(value) >= 4:
        (size,) = struct.unpack_from("<I", value)
        yield value[4 : 4 + size]
        value = value[4 + size :]


def _name(content: bytes, place: int) -> tuple[str, int]:
    """Return the name at ``place``, and the place after its end; ValueError for one that could harm a terminal."""
    end = content.find(b"\0", place, place + LONGEST_NAME + 1)
    if end < 0 and len(content) <= place + LONGEST_NAME:
        raise IndexError("name reaches beyond the file")
    if end <= place or not _is_text(name := content[place:end].decode()):
        raise ValueError("no name of an attribute or a channel")
    return name, end + 1


def _is_text(name: str) -> bool:
    """Whether a name holds letters, signs and spaces of any script, and nothing that controls a terminal."""
    return all(sign.isprintable() or sign in JOINERS or category(sign) == "Zs" for sign in name)


ONE_LEVEL, MIP_MAP, RIP_MAP = range(3)  # modes, as the file layout numbers them

Counts = NDArray[np.int64]


def tile_sizes(path: Path, columns: int, rows: int, value: bytes) -> Counts:
    """Return the pixels of each tile; a table of chunks has any order, so the smallest stands for all.

    Raises DataError for images of several levels, which are textures, and ValueError for impossible tiles.
    """
    width, height, mode = struct.unpack("<IIB", value)
    if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
        raise ValueError("tiles of no size, or larger than any image")
    if mode & 0xF in (MIP_MAP, RIP_MAP):
        raise DataError("mip-mapped images are not read", path=path, cure="write one level, in tiles or scan lines")
    if mode & 0xF != ONE_LEVEL:
        raise ValueError("no such mode of levels")
    smallest = ((columns - 1) % width + 1) * ((rows - 1) % height + 1)
    return np.broadcast_to(np.int64(smallest), -(-columns // width) * -(-rows // height))


# Largest ratio of a block of pixels to its chunk in the file, for methods that have a limit: deflate copies at most 258
# bytes for 2 bits, and run lengths repeat a byte 128 times in 2 bytes.
LARGEST_RATIO = {"none": 1, "rle": 64, "zips": 1032, "zip": 1032}


class Table(NamedTuple):
    """The table of chunks of a readable part: its place, and what its chunks must hold."""

    part: int  # its index in the file
    place: int
    layout: Layout
    pixels: Counts  # of each chunk
    leader: int  # bytes before the data of each chunk

    def check_chunks(self, read_at: ReadAt, length: int, behind: int) -> None:
        """Check that every chunk begins ``behind`` all tables, ends inside the file and can hold its pixels.

        The size of a chunk ends its ``leader`` bytes. A chunk that is smaller than its compression allows cannot be
        decoded. ``read_at`` reads bytes of the file, which has ``length``; from a file, each call acquires the GIL.
        Raises DataError, and struct.error or ValueError where bytes are missing.
        """
        path = self.layout.path
        offsets = np.frombuffer(read_at(self.place, 8 * len(self.pixels)), dtype="<u8")
        fits = bool((offsets >= behind).all() and (offsets <= length - self.leader).all())
        if fits:
            ends = (int(offset) + self.leader for offset in offsets)
            sizes = np.array([struct.unpack_from("<i", read_at(end - 4, 4))[0] for end in ends])
            fits = bool((sizes >= 0).all() and (offsets + sizes.astype("<u8") <= length - self.leader).all())
        if not fits:
            raise DataError("the file is truncated or was never finished", path=path, cure="write it again")
        ratio = LARGEST_RATIO.get(self.layout.compression)
        if ratio is not None and (sizes * ratio < self.pixels * self.layout.bytes_a_pixel).any():
            raise DataError("a chunk is too small for its pixels", path=path, cure="write it again")


def read_layout(path: Path) -> Layout:
    """Read the layout of ``path`` and check that every chunk lies inside the file, in well under a millisecond.

    Raises InputMissing where there is no readable file, and DataError for a damaged or unsupported one.
    """
    with open_regular(path) as file:
        return checked_outline(path, file, one=True).parts[0]


class Outline(NamedTuple):
    """The parts of a file by its headers, and where the tables of their chunks must be.

    ``tables`` are those of readable parts, ``faults`` the errors of the others by name. The headers end at ``end``, and
    all tables at ``behind``. ``odd`` are the places of types from ``read_headers``.
    """

    path: Path
    tables: list[Table]
    faults: dict[str, DataError]
    end: int
    behind: int
    odd: list[int]

    @property
    def parts(self) -> list[Layout]:
        """The layouts of the readable parts."""
        return [table.layout for table in self.tables]

    def check_chunks(self, read_at: ReadAt, length: int) -> None:
        """Check that every chunk lies inside the file of ``length`` bytes and can hold its pixels; raises DataError."""
        if self.behind > length:
            what = "the file is truncated inside its table of chunks"
            raise DataError(what, path=self.path, cure="write it again")
        with damaged(self.path):
            for table in self.tables:
                table.check_chunks(read_at, length, self.behind)

    def refuse_faults(self) -> None:
        """Raise the error of the first unreadable part, if there is one."""
        for error in self.faults.values():
            raise error

    def extract(self, read_at: ReadAt, tables: Sequence[Table], *, pixels: bool = True) -> list[bytes]:
        """Return the bytes of a file of the parts of these tables alone, with their chunks if ``pixels`` are wanted.

        So an unwanted part is neither decoded nor in the way. The chunks must be checked before.
        """
        head, ends = read_at(0, self.end), [8]
        for _ in range(len(self.tables) + len(self.faults)):
            ends.append(places_of(self.path, head, ends[-1])[1])
        version = struct.unpack_from("<I", head, 4)[0] & ~DEEP
        headers = (head[ends[table.part] : ends[table.part + 1]] for table in tables)
        made = [struct.pack("<II", MAGIC, version), *headers, b"\0"]
        counts = [len(table.pixels) for table in tables]
        place, offsets, chunks = sum(map(len, made)) + 8 * sum(counts), list[int](), list[bytes]()
        for number, (table, count) in enumerate(zip(tables, counts, strict=True)):
            for offset in struct.unpack(f"<{count}Q", read_at(table.place, 8 * count)):
                offsets.append(place if pixels else 0)
                if pixels:
                    leader = read_at(offset, table.leader)
                    size = struct.unpack_from("<i", leader, table.leader - 4)[0]
                    chunks += [struct.pack("<i", number), leader[4:], read_at(offset + table.leader, size)]
                    place += table.leader + size
        return [*made, struct.pack(f"<{len(offsets)}Q", *offsets), *chunks]


def checked_outline(path: Path, file: BinaryIO, *, one: bool = False) -> Outline:
    """Parse the headers of an open file as ``read_outline`` does, and check its chunks."""
    outline = read_outline(path, file, one=one)
    outline.check_chunks(partial(read_at, file), file_size(file))
    return outline


def read_outline(path: Path, file: BinaryIO, *, one: bool = False) -> Outline:
    """Parse the headers of an open file, of one part where ``one`` says so, without its chunks; raises DataError."""
    with damaged(path):
        version, headers, odd, end = read_headers(path, file)
        many = bool(version & MULTI_PART)
        names = [header["name"].decode() for header in headers] if many else [""]
        if len({*names}) < len(names) or not all(map(_is_text, names)):
            raise ValueError("parts of one name, or of a name that could harm a terminal")
        tables, faults, place = list[Table](), dict[str, DataError](), end
        for part, (name, header) in enumerate(zip(names, headers, strict=True)):
            try:
                tables.append(Table(part, place, *_part(path, header, version, tables)))
                place += 8 * len(tables[-1].pixels)
            except DataError as error:
                faults[name] = error
                # A negative count becomes more chunks than any file has.
                place += 8 * struct.unpack("<I", header["chunkCount"])[0] if many else 0
    outline = Outline(path, tables, faults, end, place, odd)
    if not tables:
        outline.refuse_faults()
    if one and many:
        raise DataError("multi-part images are not read", path=path, cure=OTHER_TOOLS)
    return outline


def _part(path: Path, header: Header, version: int, before: Sequence[Table]) -> tuple[Layout, Counts, int]:
    """Return a part's layout, the pixels of its chunks, and the bytes before the data of each."""
    many = bool(version & MULTI_PART)
    tiled = header["type"] == b"tiledimage" if many else bool(version & TILED)
    part = _layout(path, header, tiled, many=many)
    if before and part.display_window != before[0].layout.display_window:
        raise DataError("the parts do not make one picture", path=path, cure="write them with one display window")
    # A chunk begins with its part (if there are many), its place (y, or four numbers) and its size.
    return part, _chunk_sizes(part, header, tiled), 4 * many + (20 if tiled else 8)


def _layout(path: Path, header: Header, tiled: bool, *, many: bool) -> Layout:
    if header.get("type", b"").startswith(b"deep"):
        raise _deep(path)
    if many and header["type"] not in (b"scanlineimage", b"tiledimage"):
        raise DataError("unknown type of part", path=path, expected="scanlineimage or tiledimage")
    (codec,) = header["compression"]
    if codec >= len(COMPRESSIONS):
        raise DataError("unknown compression", path=path, found=codec, cure="write it with ZIP compression")
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
    """Return the pixels of each chunk of a part."""
    if tiled:
        sizes = tile_sizes(layout.path, layout.width, layout.height, header["tiles"])
    else:
        rows = COMPRESSIONS[header["compression"][0]][1]
        sizes = np.minimum(rows, layout.height - np.arange(0, layout.height, rows)) * layout.width
    if layout.part is not None and struct.unpack("<i", header["chunkCount"]) != (len(sizes),):
        raise ValueError("not as many chunks as the windows ask for")
    return sizes


def _check_windows(layout: Layout) -> None:
    for name, window in (("data window", layout.data_window), ("display window", layout.display_window)):
        width, height = window[2] - window[0] + 1, window[3] - window[1] + 1
        if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
            expected = f"1 to {LARGEST_SIDE} pixels a side"
            raise DataError(f"impossible {name}", path=layout.path, expected=expected, found=f"{width} x {height}")
