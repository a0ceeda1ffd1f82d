"""Damaged headers, each told apart from the others by what is wrong with it."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import pytest

from cltaa.errors import DataError
from cltaa.io.exr_header import MOST_ATTRIBUTES, MOST_PARTS, read_channels, read_headers

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
    _, headers, _ = read_headers(Path("a.exr"), io.BytesIO(START + b"".join(map(attribute, names)) + b"\0"))
    assert [*headers[0]] == names
    _, headers, _ = read_headers(Path("a.exr"), io.BytesIO(MANY_PARTS + MOST_PARTS * (attribute("a") + b"\0") + b"\0"))
    assert len(headers) == MOST_PARTS


@pytest.mark.parametrize("value", [2 * channel("R"), channel("R", kind=-1)])
def test_channels_that_cannot_be(value: bytes) -> None:
    with pytest.raises(ValueError, match="channel twice, or of no type"):
        read_channels(Path("a.exr"), value + b"\0")
