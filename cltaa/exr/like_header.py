"""The header of a file from that of an earlier one: where only values differ, their bytes are put in their places.

OpenEXR takes a while to write a header, in which no other thread has the interpreter, and those of a sequence differ in
a number, two matrices and a jitter. How a value stands in a file is not taken on trust: that of the earlier file has to
stand there so, else OpenEXR writes the header.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Hashable, Mapping
from typing import Any, NamedTuple

import numpy as np

from cltaa.io.exr_header import places_of

Value = tuple[Hashable, bytes]  # what a value is, and its bytes, of which there are as many for all of its kind


class _Earlier(NamedTuple):
    """A header as OpenEXR wrote it, what it was written from, and where its values stand."""

    kinds: Hashable
    values: dict[str, bytes]
    content: bytes
    places: dict[str, slice]


_earlier: _Earlier | None = None  # the last that OpenEXR wrote, of whatever thread


def like_earlier(header: Mapping[str, Any], shape: Hashable, write: Callable[[], bytes]) -> bytes:
    """The bytes that ``write`` returns for ``header``, without it where an earlier one was of this kind.

    ``shape`` is all else that decides them. Raises what ``write`` raises.
    """
    global _earlier
    values = {name: _value(value) for name, value in header.items()}
    known = {name: value[1] for name, value in values.items() if value is not None}
    if len(known) < len(values):
        return write()
    kinds = shape, tuple((name, value[0]) for name, value in values.items() if value is not None)
    earlier = _earlier
    found = _patched(earlier, known) if earlier is not None and earlier.kinds == kinds else None
    if found is None:
        found = write()
        _earlier = _Earlier(kinds, known, found, places_of(found))
    return found


def _patched(earlier: _Earlier, values: Mapping[str, bytes]) -> bytes | None:
    content = bytearray(earlier.content)
    for name, value in values.items():
        before = earlier.values[name]
        if value != before:
            place = earlier.places.get(name)
            if place is None or earlier.content[place] != before:
                return None
            content[place] = value
    return bytes(content)


def _value(value: object) -> Value | None:
    """What a value is, and its bytes as they may stand in a file; None for what nothing is known of."""
    try:
        if isinstance(value, np.ndarray):
            return ((value.dtype.str, value.shape), value.tobytes()) if value.dtype.kind in "fiu" else None
        if isinstance(value, str):
            text = value.encode()
            return (str, len(text)), text
        if type(value) is int:
            return (int, 4), struct.pack("<i", value)
        if isinstance(value, tuple):  # of arrays, as windows are: another one is another kind
            parts = [_value(part) if isinstance(part, np.ndarray) else None for part in value]
            return None if None in parts else ((tuple, *parts), b"")
        hash(value)
    except (UnicodeEncodeError, struct.error, TypeError):
        return None
    return (type(value), value), b""  # likewise the compression, and a float, which OpenEXR may find impossible
