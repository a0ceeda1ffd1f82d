"""Bytes deflated to where they are wanted, by the C library inside of the Python module ``isal``.

The module's own call begins with 16 KiB for the result and doubles them, each time by a turn with the interpreter: four
to six a chunk. The library takes memory of ours, and one turn. Structure and functions have their names and order in
its header (igzip_lib.h of ISA-L 2.31).
"""

from __future__ import annotations

import threading
import zlib
from collections.abc import Callable
from ctypes import (
    CDLL,
    POINTER,
    PyDLL,
    Structure,
    addressof,
    byref,
    c_char,
    c_int,
    c_uint8,
    c_uint16,
    c_uint32,
    c_void_p,
    memset,
    sizeof,
)
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

try:
    from isal import isal_zlib
except ImportError:  # not made for every machine: there OpenEXR packs
    isal_zlib = None

Bytes = NDArray[np.uint8]
# Packs the first bytes into the others, as a stream of zlib's format; says how many of these it took, or 0 where the
# stream would fill them.
Deflate = Callable[[Bytes, Bytes], int]

LEVEL = 2  # of ISA-L's 0 to 3; docs/performance.md, Files
ZLIB = 3  # the library's number of that format
BUFFER_BYTES = 2**18  # for what is found before it is written; the module's own
STATE_BYTES = 2**17  # of a stream, behind what is looked at here: 82 kB, by that header


_NONE = c_char * 0


class _Stream(Structure):
    _fields_ = (
        ("next_in", c_void_p),
        ("avail_in", c_uint32),
        ("total_in", c_uint32),
        ("next_out", c_void_p),
        ("avail_out", c_uint32),
        ("total_out", c_uint32),
        ("hufftables", c_void_p),
        ("level", c_uint32),
        ("level_buf_size", c_uint32),
        ("level_buf", c_void_p),
        ("end_of_stream", c_uint16),
        ("flush", c_uint16),
        ("gzip_flag", c_uint16),
        ("hist_bits", c_uint16),
        ("others", c_uint8 * STATE_BYTES),
    )


class _Core(NamedTuple):
    """The library twice: what takes long lets other threads use the interpreter, what is quick takes no turn for it."""

    long: CDLL
    quick: PyDLL


class _OfThread(threading.local):
    """A stream, and the memory that it works in."""

    def __init__(self) -> None:
        self.stream, self.buffer = _Stream(), np.empty(BUFFER_BYTES, np.uint8)
        self.reference, self.address = byref(self.stream), self.buffer.ctypes.data


_OF_THREAD = _OfThread()


def fast_deflate() -> Deflate | None:
    """What packs chunks: the library, or the module where that cannot be reached; None where there is neither."""
    if isal_zlib is None:
        return None
    return deflate if core() is not None else deflate_by_module


@cache
def core() -> _Core | None:
    """The library, or None where it cannot be reached or does not do what it is known to do."""
    try:
        found = _Core(CDLL(isal_zlib.__file__), PyDLL(isal_zlib.__file__))
        for function in (found.quick.isal_deflate_init, found.long.isal_deflate):
            function.argtypes = (POINTER(_Stream),)
        found.quick.isal_deflate_init.restype, found.long.isal_deflate.restype = None, c_int
    except (OSError, AttributeError, TypeError):
        return None
    return found if sizeof(c_void_p) == 8 and _understood(found) else None


def deflate(source: Bytes, target: Bytes) -> int:
    """Pack contiguous ``source`` into contiguous ``target``, by the library; see ``Deflate``."""
    library = core()
    assert library is not None
    return _deflate(library, source, target)


def deflate_by_module(source: Bytes, target: Bytes) -> int:
    """The same by the module."""
    small = isal_zlib.compress(source.data, level=LEVEL)
    if len(small) >= len(target):
        return 0
    target[: len(small)] = np.frombuffer(small, np.uint8)
    return len(small)


def _deflate(library: _Core, source: Bytes, target: Bytes) -> int:
    # Every line of this holds the interpreter, for each chunk: others wait for it.
    own = _OF_THREAD
    stream, reference = own.stream, own.reference
    library.quick.isal_deflate_init(reference)
    stream.level, stream.level_buf, stream.level_buf_size = LEVEL, own.address, BUFFER_BYTES
    stream.gzip_flag, stream.end_of_stream = ZLIB, 1
    stream.next_in, stream.avail_in = _address(source), len(source)
    stream.next_out, stream.avail_out = _address(target), len(target)
    if library.long.isal_deflate(reference) or not stream.avail_out:
        return 0
    return int(stream.total_out)


def _address(content: Bytes) -> int:
    """Where bytes that may be written to lie, in a third of the time that ``ctypes.data`` takes to say so."""
    memory: Any = content
    return addressof(_NONE.from_buffer(memory))


def _understood(library: _Core) -> bool:
    """True where the library and this module mean the same structure: its beginning is set, and a stream is whole."""
    stream = _OF_THREAD.stream
    memset(byref(stream), 0xAA, sizeof(stream))
    library.quick.isal_deflate_init(byref(stream))
    told = stream.level, stream.level_buf, stream.end_of_stream, stream.flush, stream.gzip_flag, stream.hist_bits
    if any(told) or not stream.hufftables:
        return False
    sample, packed = np.arange(1000, dtype=np.uint8), np.empty(1000, np.uint8)
    size = _deflate(library, sample, packed)
    try:
        return zlib.decompress(packed[:size].tobytes()) == sample.tobytes()
    except zlib.error:
        return False
