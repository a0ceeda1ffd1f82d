"""EXR files out, each complete or absent, packed with ZIP by ISA-L.

OpenEXR writes the header, so that every attribute has its form. This module makes the chunks, as the OpenEXR file
layout defines them (https://openexr.com/en/latest/OpenEXRFileLayout.html) and OpenEXR's own packer makes them: of the
bytes of some rows first those at even places and then those at odd ones; each but the first replaced by its difference
from the one before it, plus 128; deflated, in a stream of zlib's format.
"""

from __future__ import annotations

import os
import struct
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.core.frame_checks import check_fields
from cltaa.errors import DataError, StorageError, UsageError, public
from cltaa.frame import Frame
from cltaa.io.atomic import atomic_path
from cltaa.io.exr_frame import STRUCTURAL, Pixels, Single, frame_attributes, frame_planes
from cltaa.io.exr_header import UNKNOWN, hidden_types, places_of, read_at, read_headers, read_layout
from cltaa.io.exr_layout import COMPRESSION_NUMBERS, Windows, check_lossless
from cltaa.io.names import numbers_of
from cltaa.io.openexr import OpenEXR

try:
    from isal import isal_zlib
except ImportError:  # not available for every machine: there OpenEXR packs
    isal_zlib = None

Bytes = NDArray[np.uint8]

LEVEL = 2  # of ISA-L's 0 to 3; docs/performance.md, Files

# Threads acquire the GIL between the steps of their work, so a few threads with large steps
# (docs/decisions/13-io-pipeline.md).
THREADS = 4
BEGUN = THREADS + 1  # blocks of one file at a time: packed, being packed, or waiting
ROWS = 64  # that a thread packs at a time: 4 chunks of ZIP, 64 of ZIPS
ROWS_A_CHUNK = {"zip": 16, "zips": 1}


class Packed(NamedTuple):
    """Neighbouring chunks in the form of the file, and the bytes of each."""

    sizes: list[int]
    content: bytes


Pack = Callable[[int], Packed]


def write_zip(path: Path, header: Mapping[str, Any], channels: Mapping[str, NDArray[Any]], compression: str) -> None:
    """Write contiguous ``channels`` [H, W] as ``OpenEXR.File(header, channels)`` does, with its errors and OSError, but
    deflated by ISA-L."""
    height, width = next(iter(channels.values())).shape
    first, last = header.get("dataWindow", np.array([[0, 0], [width - 1, height - 1]], np.int32))
    planes = [channels[name].view(np.uint8) for name in sorted(channels)]
    start = _header(path, header, channels, first, last)
    pack = partial(_pack, planes, int(first[1]), ROWS_A_CHUNK[compression])
    sizes = [0]
    with path.open("wb") as file:
        file.write(start + bytes(8 * -(-height // ROWS_A_CHUNK[compression])))
        sizes[0] = file.tell()
        for packed in _in_threads(pack, range(0, height, ROWS)):
            file.write(packed.content)
            sizes += packed.sizes
        file.seek(len(start))
        file.write(np.cumsum(sizes[:-1], dtype="<u8").data)  # the offset of each chunk


def _in_threads(pack: Pack, rows: range) -> Iterator[Packed]:
    """Yield ``pack(row)`` for each of ``rows``, in their order, with ``BEGUN`` of them at a time."""
    begun = deque[Callable[[], Packed]]()
    for row in rows:
        begun.append(_begin(pack, row))
        if len(begun) == BEGUN:
            yield begun.popleft()()
    while begun:
        yield begun.popleft()()


def _begin(pack: Pack, row: int) -> Callable[[], Packed]:
    try:
        return _threads().submit(pack, row).result
    except RuntimeError:  # at shutdown threads take no more work, and queued files are still written
        return partial(pack, row)


@cache
def _threads() -> ThreadPoolExecutor:
    """Return the threads for all files, which end with the program."""
    return ThreadPoolExecutor(THREADS, "pack EXR")


os.register_at_fork(after_in_child=_threads.cache_clear)  # a fork has none of its parent's threads


def _header(
    path: Path, header: Mapping[str, Any], channels: Mapping[str, NDArray[Any]], first: Any, last: Any
) -> bytes:
    """Return the bytes before the table of chunks: those of a file of the first row, except for the last row."""

    row, file = np.array([first, [last[0], first[1]]], np.int32), BytesIO()
    windows = {"displayWindow": (first, last), **header, "dataWindow": tuple(row)}
    OpenEXR.File(windows, {name: plane[:1] for name, plane in channels.items()}).write(file)
    *_, end = read_headers(path, file)
    content = file.getvalue()
    window = places_of(path, content)[0]["dataWindow"].value.start
    return content[: window + 12] + struct.pack("<i", last[1]) + content[window + 16 : end]


def _pack(planes: list[Bytes], top: int, rows_a_chunk: int, row: int) -> Packed:
    """Return the chunks of up to ``ROWS`` rows from ``row`` on, of planes [H, bytes] whose first row is y ``top``."""
    end = min(row + ROWS, len(planes[0]))
    even = end - (end - row) % rows_a_chunk  # where the last chunk begins, if it has fewer rows
    chunks: list[tuple[Bytes, Bytes]] = []
    for start, stop, each in ((row, even, rows_a_chunk), (even, end, end - even)):
        if start < stop:
            chunks += _stepped([plane[start:stop] for plane in planes], each)
    content, sizes = list[bytes](), list[int]()
    for y, (raw, steps) in zip(range(top + row, top + end, rows_a_chunk), chunks, strict=True):
        packed = isal_zlib.compress(steps.data, level=LEVEL)
        if len(packed) >= len(raw):  # stored raw if packing does not make it smaller: a reader tells by its size
            packed = raw.tobytes()
        content += struct.pack("<2i", y, len(packed)), packed
        sizes.append(8 + len(packed))
    return Packed(sizes, b"".join(content))


def _stepped(planes: list[Bytes], rows: int) -> Iterator[tuple[Bytes, Bytes]]:
    """Yield chunks of ``rows`` rows each, of planes [a multiple of them, bytes]: raw, and prepared for deflate."""
    lines = np.concatenate(planes, axis=1)
    raw = lines.reshape(-1, lines.shape[1] * rows)
    pairs, half = raw.view("<u2"), raw.shape[1] // 2
    split, steps = np.empty_like(raw), np.empty_like(raw)
    split[:, :half] = pairs  # the lower byte
    np.right_shift(pairs, 8, out=split[:, half:], casting="unsafe")
    steps[:, 0] = split[:, 0]
    np.subtract(split[:, 1:], split[:, :-1], out=steps[:, 1:])
    steps[:, 1:] += 128
    return zip(raw, steps, strict=True)


# Attributes that OpenEXR stores as float; other Python floats are written as doubles, so that none is rounded.
_STANDARD_FLOATS = frozenset({"pixelAspectRatio", "screenWindowWidth", "whiteLuminance", "xDensity", "expTime"})


@public("write_frame")
def write_frame(path: str | Path, frame: Frame, *, compression: str = "zip") -> None:
    """Write one frame as a multi-channel EXR of float32 channels (``id`` uint32), atomically.

    Raises UsageError for a name of another format, DataError for a wrong frame or a name with another number,
    OutputError and StorageError for disks.
    """
    if not isinstance(path, str | Path) or not isinstance(frame, Frame):
        found = f"{type(path).__name__}, {type(frame).__name__}"
        raise UsageError("no frame to write", expected="a path and a cltaa.Frame", found=found)
    path = Path(path)
    if path.suffix.lower() != ".exr":
        expected, found = "a name that ends in .exr", path.suffix or "no suffix"
        raise UsageError("frames are written as EXR", path=path, expected=expected, found=found)
    check_fields(frame)
    attributes, numbers = frame_attributes(frame), numbers_of(path)
    if numbers and not {*numbers} & {frame.index, -frame.index}:  # whether shot-003 is 3 or -3 its folder decides
        what, cure = "the file name has another number than the frame", "reading it would be refused: give both one"
        raise DataError(what, path=path, expected=frame.index, found=numbers[0], cure=cure)
    write_image(path, frame_planes(frame, path), attributes, compression=compression)


def write_image(
    path: Path,
    channels: Mapping[str, Pixels],
    attributes: Mapping[str, object] | None = None,
    *,
    compression: str = "zip",
    windows: Windows | None = None,
) -> None:
    """Write channels ``[H, W]`` (float16, float32 or uint32, as given) and attributes as one EXR, atomically.

    ``compression`` is a lossless one; ``windows`` are those of data and display, by default from (0, 0) on. Python
    floats become doubles, except ``exr_frame.Single``; arrays keep their precision. Empty lists are left out. Raises
    UsageError for invalid arguments, OutputError and StorageError for disks.
    """
    check_lossless(compression, path)
    shapes = {pixels.shape for pixels in channels.values()}
    types = {pixels.dtype.name for pixels in channels.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 2 or not types <= {"float16", "float32", "uint32"}:
        expected = "channels of one shape [H, W], float16, float32 or uint32"
        raise UsageError("channels do not make an image", path=path, expected=expected, found=(shapes, types))
    given = {name: value for name, value in (attributes or {}).items() if name not in STRUCTURAL}
    # OpenEXR reads an empty list, but cannot tell the type of its elements, and writes none.
    header = {name: _attribute(name, value) for name, value in given.items() if not isinstance(value, list) or value}
    header["compression"] = OpenEXR.Compression(COMPRESSION_NUMBERS[compression])
    header["type"] = OpenEXR.scanlineimage
    for name, window in zip(("dataWindow", "displayWindow"), windows or (), strict=False):
        corners = np.array(window, np.int32).reshape(2, 2)
        header[name] = (corners[0], corners[1])
    # OpenEXR writes wrong pixels, silently, from an array that is not contiguous.
    contiguous = {name: np.ascontiguousarray(pixels) for name, pixels in channels.items()}
    with atomic_path(path) as temporary:
        try:
            if isal_zlib is not None and compression in ROWS_A_CHUNK:
                write_zip(temporary, header, contiguous, compression)
            else:
                # As bytes: OpenEXR does not accept a str made from a name that is not UTF-8.
                OpenEXR.File(header, contiguous).write(os.fsencode(temporary))
                # OpenEXR does not report a write that fails on closing the file; the table of chunks is then
                # incomplete.
                read_layout(temporary)
            if any(getattr(value, "typeName", "").startswith(chr(UNKNOWN)) for value in header.values()):
                _show_types(temporary)
        except (RuntimeError, ValueError, TypeError, DataError) as error:
            what = f"OpenEXR could not write it: {error}"
            raise StorageError(what, path=path, cure="check the free space") from error


def _show_types(path: Path) -> None:
    """Give each attribute its own type again that the reader hid from OpenEXR's Python module."""
    with path.open("r+b") as file:
        *_, end = read_headers(path, file)
        for place, letter in hidden_types(path, read_at(file, 0, end)).items():
            file.seek(place)
            file.write(letter)


def _attribute(name: str, value: object) -> object:
    if isinstance(value, float) and not isinstance(value, Single) and name not in _STANDARD_FLOATS:
        return np.array([value], dtype=np.float64)  # a bare float would be rounded to float32
    return value
