"""EXR files packed with ZIP or ZIPS by ISA-L, in a third of the processor time of the packer inside OpenEXR.

OpenEXR writes the header, so that every attribute is as it writes it. The chunks are made here, as the OpenEXR file
layout defines them (https://openexr.com/en/latest/OpenEXRFileLayout.html) and OpenEXR's own packer makes them: of the
bytes of some rows first those at even places and then those at odd ones; of each but the first what it is more than
the one before it, plus 128; deflated, in a stream of zlib's format.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from cltaa.exr_header import place_of, read_headers

try:
    from isal import isal_zlib
except ImportError:  # not made for every machine: there OpenEXR packs
    isal_zlib = None

# ISA-L's levels are 0 to 3; docs/performance.md, Files.
LEVEL = 2
ROWS = 16  # that a thread packs at a time: one chunk of ZIP, 16 of ZIPS
ROWS_A_CHUNK = {"zip": 16, "zips": 1}

Bytes = NDArray[np.uint8]
Deflate = Callable[[memoryview], bytes]
Chunk = memoryview | bytes


def fast_deflate() -> Deflate | None:
    """What packs bytes into a stream of zlib's format; None where there is only OpenEXR's own."""
    return partial(isal_zlib.compress, level=LEVEL) if isal_zlib else None


def write_zip(
    path: Path, header: Mapping[str, Any], channels: Mapping[str, NDArray[Any]], compression: str, deflate: Deflate
) -> None:
    """Write contiguous ``channels`` [H, W] as ``OpenEXR.File(header, channels)`` does, but with its ``deflate``.

    ``header`` is one of OpenEXR's for scan lines with that ``compression``, ``zip`` or ``zips``. Raises what OpenEXR
    raises, and OSError.
    """
    height, width = next(iter(channels.values())).shape
    first, last = header.get("dataWindow", np.array([[0, 0], [width - 1, height - 1]], np.int32))
    top, rows_a_chunk = int(first[1]), ROWS_A_CHUNK[compression]
    table = np.zeros(-(-height // rows_a_chunk), "<u8")
    planes = [channels[name].view(np.uint8) for name in sorted(channels)]
    start = _header(path, header, channels, first, last)
    pack = partial(_chunks, planes, rows_a_chunk, deflate)
    packed = _in_threads(pack, range(0, height, ROWS))
    with path.open("wb") as file:
        place = file.write(start) + file.write(table.data)
        for number, chunk in enumerate(chunk for chunks in packed for chunk in chunks):
            table[number] = place
            place += file.write(struct.pack("<2i", top + number * rows_a_chunk, len(chunk))) + file.write(chunk)
        file.seek(len(start))
        file.write(table.data)


def _in_threads(pack: Callable[[int], list[Chunk]], rows: range) -> Iterator[list[Chunk]]:
    """``pack(row)`` for each of ``rows``, in their order; for one more of them than there are threads ahead of use."""
    count = max(1, OpenEXR.global_thread_count())
    begun = deque[Callable[[], list[Chunk]]]()
    for row in rows:
        begun.append(_begin(_threads(count), pack, row))
        if len(begun) > count:
            yield begun.popleft()()
    while begun:
        yield begun.popleft()()


def _begin(threads: ThreadPoolExecutor, pack: Callable[[int], list[Chunk]], row: int) -> Callable[[], list[Chunk]]:
    try:
        return threads.submit(pack, row).result
    except RuntimeError:  # at the end of the program no thread is given work, and what is queued is written still
        return partial(pack, row)


@cache
def _threads(count: int) -> ThreadPoolExecutor:
    """For all files that are being written; as many as OpenEXR has, and like those there until the program ends."""
    return ThreadPoolExecutor(count, "pack EXR")


def _header(
    path: Path, header: Mapping[str, Any], channels: Mapping[str, NDArray[Any]], first: Any, last: Any
) -> bytes:
    """What stands in the file before the table of chunks: that of a file of the first row, but for the last row."""
    row, file = np.array([first, [last[0], first[1]]], np.int32), BytesIO()
    windows = {"displayWindow": (first, last), **header, "dataWindow": tuple(row)}
    OpenEXR.File(windows, {name: plane[:1] for name, plane in channels.items()}).write(file)
    *_, end = read_headers(path, file)
    content = file.getvalue()
    window = place_of(content, "dataWindow")
    return content[: window + 12] + struct.pack("<i", last[1]) + content[window + 16 : end]


def _chunks(planes: list[Bytes], rows_a_chunk: int, deflate: Deflate, row: int) -> list[Chunk]:
    """The chunks of up to ``ROWS`` rows from ``row`` on, of planes [H, bytes of a row]."""
    lines = np.concatenate([plane[row : row + ROWS] for plane in planes], axis=1)
    raw = lines.reshape(-1, lines.shape[1] * min(rows_a_chunk, len(lines)))
    pairs, half = raw.view("<u2"), raw.shape[1] // 2
    split, steps = np.empty_like(raw), np.empty_like(raw)
    split[:, :half] = pairs  # its lower byte
    np.right_shift(pairs, 8, out=split[:, half:], casting="unsafe")
    steps[:, 0] = split[:, 0]
    np.subtract(split[:, 1:], split[:, :-1], out=steps[:, 1:])
    steps[:, 1:] += 128
    packed = [deflate(chunk.data) for chunk in steps]
    # What does not become smaller is written as it is, which a reader tells by its size.
    return [small if len(small) < len(whole) else whole.data for small, whole in zip(packed, raw, strict=True)]
