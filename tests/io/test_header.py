"""Damaged headers, told apart by what is wrong with each; how small a chunk and a tile may be for their pixels."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest

from cltaa.errors import DataError
from cltaa.io.exr_header import MOST_ATTRIBUTES, MOST_PARTS, ONE_LEVEL, Table, read_channels, read_headers, tile_sizes
from cltaa.io.exr_layout import Layout

START = struct.pack("<II", 20000630, 2)
MANY_PARTS = struct.pack("<II", 20000630, 2 | 1 << 12)


def attribute(name: str, value: bytes = b"", size: int | None = None) -> bytes:
    return name.encode() + b"\0int\0" + struct.pack("<i", len(value) if size is None else size) + value


def channel(name: str, kind: int = 1) -> bytes:
    return name.encode() + b"\0" + struct.pack("<4i", kind, 0, 1, 1)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (START + b"name", "name reaches beyond the file"),
        (START + b"name\0int\0\1\2", "attribute without a size"),
        (START + attribute("a", size=-1) + b"\0", "attribute of a negative size"),
        (START + 2 * attribute("a") + b"\0", "attribute of a negative size, or twice"),
        (START + b"".join(attribute(f"a{n}") for n in range(MOST_ATTRIBUTES + 1)) + b"\0", "too many attributes"),
        (START + attribute("a", b"value", size=99), "attribute reaches beyond the file"),
        (START + attribute("\x1b[2J") + b"\0", "no name of an attribute or a channel"),
        (MANY_PARTS + (MOST_PARTS + 1) * (attribute("a") + b"\0") + b"\0", "too many parts"),
    ],
)
def test_what_is_wrong_is_said(content: bytes, says: str) -> None:
    with pytest.raises((ValueError, IndexError, DataError), match=says):
        read_headers(Path("a.exr"), io.BytesIO(content))


def test_as_many_as_are_allowed_are_read() -> None:
    names = [f"a{n}" for n in range(MOST_ATTRIBUTES)]
    _, headers, *_ = read_headers(Path("a.exr"), io.BytesIO(START + b"".join(map(attribute, names)) + b"\0"))
    assert [*headers[0]] == names
    _, headers, *_ = read_headers(Path("a.exr"), io.BytesIO(MANY_PARTS + MOST_PARTS * (attribute("a") + b"\0") + b"\0"))
    assert len(headers) == MOST_PARTS


@pytest.mark.parametrize("value", [2 * channel("R"), channel("R", kind=-1)])
def test_channels_that_cannot_be(value: bytes) -> None:
    with pytest.raises(ValueError, match="channel twice, or of no type"):
        read_channels(Path("a.exr"), value + b"\0")


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
