"""Pixels decoded to where they are wanted, by the C library inside of OpenEXR's Python module.

The module allocates what it decodes, thousands of page faults a frame, and it has to be moved from there. OpenEXRCore,
which it is made of, decodes into any memory. Structures and functions have their names and order in its headers
(openexr_coding.h, openexr_chunkio.h, openexr_decode.h of 3.5). What is not decoded here is the module's to decode, and
to say what is wrong: tiles, damaged files, a library of another version or without these functions.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from ctypes import (
    CDLL,
    POINTER,
    PyDLL,
    Structure,
    byref,
    c_char_p,
    c_int,
    c_int8,
    c_int16,
    c_int32,
    c_size_t,
    c_uint8,
    c_uint16,
    c_uint64,
    c_void_p,
    sizeof,
)
from functools import cache
from typing import Any, NamedTuple

from numpy.typing import NDArray

from cltaa.exr.layout import COMPRESSIONS, PIXEL_BYTES, Layout
from cltaa.exr.openexr import OpenEXR
from cltaa.exr.quiet import muted_output
from cltaa.files.content import Copy

VERSION = (3, 5)  # of the library: the first two numbers
NUMBER = 4  # bytes of what is made here
OWN_BYTES = 432  # of a pipeline, behind what is looked at here: 528 in all, by openexr_decode.h of 3.5
TYPES = {"uint32": 0, "float32": 2}  # the library's numbers of that


class _Channel(Structure):
    _fields_ = (
        ("channel_name", c_char_p), ("height", c_int32), ("width", c_int32), ("x_samples", c_int32),
        ("y_samples", c_int32), ("p_linear", c_uint8), ("bytes_per_element", c_int8), ("data_type", c_uint16),
        ("user_bytes_per_element", c_int16), ("user_data_type", c_uint16), ("user_pixel_stride", c_int32),
        ("user_line_stride", c_int32), ("decode_to_ptr", c_void_p),
    )  # fmt: skip


class _Chunk(Structure):
    _fields_ = (
        ("idx", c_int32), ("start_x", c_int32), ("start_y", c_int32), ("height", c_int32), ("width", c_int32),
        ("level_x", c_uint8), ("level_y", c_uint8), ("type", c_uint8), ("compression", c_uint8),
        ("sizes", c_uint64 * 5),
    )  # fmt: skip


class _Pipeline(Structure):
    _fields_ = (
        ("pipe_size", c_size_t), ("channels", POINTER(_Channel)), ("channel_count", c_int16),
        ("decode_flags", c_uint16), ("part_index", c_int), ("context", c_void_p), ("chunk", _Chunk),
        ("others", c_uint8 * OWN_BYTES),
    )  # fmt: skip


class _Core(NamedTuple):
    """The library twice: what takes long lets other threads use the interpreter, what is quick takes no turn for it."""

    long: CDLL
    quick: PyDLL


class _Place(NamedTuple):
    """Where a channel goes: the first number of it, bytes from row to row, and the library's number of its type."""

    address: int
    line: int
    kind: int


class _File:
    """An open file; it is closed when the last thread that works on it has ended."""

    def __init__(self, core: _Core, content: Copy) -> None:
        self.core, self.context = core, c_void_p()
        self.failed = bool(
            core.long.exr_start_read(byref(self.context), f"/proc/self/fd/{content.fileno()}".encode(), None)
        )

    def __del__(self) -> None:
        """Close it."""
        if self.context:
            self.core.long.exr_finish(byref(self.context))


class _Picture:
    """A file, and of each of its channels, in their order, where it goes, if anywhere."""

    def __init__(self, file: _File, layout: Layout, planes: Mapping[str, NDArray[Any]]) -> None:
        self.file, self.layout = file, layout
        self._planes = planes  # which are there until all threads have ended
        self.places = [self._place(name) for name in sorted(layout.channels, key=str.encode)]

    def _place(self, name: str) -> _Place | None:
        if name not in self._planes:
            return None
        plane = self._planes[name]
        line, step = plane.strides
        if step != NUMBER or plane.shape != (self.layout.height, self.layout.width):
            raise ValueError("a plane has numbers side by side, as many as the picture")
        return _Place(plane.ctypes.data, line, TYPES[plane.dtype.name])


@cache
def core() -> _Core | None:
    """The library, or None where it is not that of ``VERSION`` or cannot be reached."""
    try:
        found = _Core(CDLL(OpenEXR.__file__), PyDLL(OpenEXR.__file__))
        major, minor, patch, extra = c_int(), c_int(), c_int(), c_char_p()
        found.long.exr_get_library_version(byref(major), byref(minor), byref(patch), byref(extra))
        for name in ("initialize", "choose_default_routines", "update", "run", "destroy"):
            getattr(found.long, f"exr_decoding_{name}")
    except (OSError, AttributeError, TypeError):
        return None
    return found if (major.value, minor.value) == VERSION and sizeof(c_void_p) == 8 else None


def decode(content: Copy, layout: Layout, planes: Mapping[str, NDArray[Any]]) -> bool:
    """Decode channels of a file whose layout was checked into ``planes`` [H, W], float32 or uint32, their rows apart
    as one likes; other channels are left out. Halves are widened. False where the planes are not, or not all, filled.
    """
    library = core()
    if library is None:
        return False
    with muted_output():
        file = _File(library, content)
        return not file.failed and _in_threads(_Picture(file, layout, planes))


def _in_threads(picture: _Picture) -> bool:
    """Decode all chunks in as many threads as OpenEXR has; True where each of them is there."""
    layout, count = picture.layout, OpenEXR.global_thread_count()
    rows = range(0, layout.height, dict(COMPRESSIONS)[layout.compression])
    left = iter(rows)  # of which each thread takes the next
    count = min(count, len(rows))
    if count <= 1:
        return _decode(picture, left)
    try:
        begun = [_threads(OpenEXR.global_thread_count()).submit(_decode, picture, left) for _ in range(count)]
        wait(begun)
    except BaseException as error:
        deque(left, maxlen=0)  # nothing is left to those that have begun
        if isinstance(error, RuntimeError):  # at the end of the program no thread is given work
            return False
        raise
    return all(each.result() for each in begun)


@cache
def _threads(count: int) -> ThreadPoolExecutor:
    """For all files that are being read; there until the program ends."""
    return ThreadPoolExecutor(count, "unpack EXR")


def _decode(picture: _Picture, left: Iterator[int]) -> bool:
    """Decode the chunks that begin at the rows that are ``left``, with one pipeline."""
    (long, quick), context, layout = picture.file.core, picture.file.context, picture.layout
    chunk, pipeline, begun = _Chunk(), _Pipeline(pipe_size=sizeof(_Pipeline)), False
    both = (context, 0, byref(chunk), byref(pipeline))
    top, width, height = layout.data_window[1], layout.width, layout.height
    targets: _Targets | None = None
    try:
        for row in left:
            if quick.exr_read_scanline_chunk_info(context, 0, top + row, both[2]):
                return False
            if (chunk.start_y, chunk.width) != (top + row, width) or not 0 < chunk.height <= height - row:
                return False
            if (quick.exr_decoding_update if begun else quick.exr_decoding_initialize)(*both):
                return False
            first, begun = targets is None, True
            if targets is None:
                if not _understood(pipeline, layout):
                    return False
                targets = _Targets(pipeline, picture.places)
            if not targets.set(row):
                return False
            if first and quick.exr_decoding_choose_default_routines(context, 0, both[3]):
                return False
            if long.exr_decoding_run(context, 0, both[3]):
                return False
        return True
    finally:
        if begun:
            quick.exr_decoding_destroy(context, both[3])


def _understood(pipeline: _Pipeline, layout: Layout) -> bool:
    """True where the library and this module mean the same channels, at the same places of their structures."""
    found = {
        channel.channel_name: (channel.width, channel.bytes_per_element, channel.x_samples, channel.y_samples)
        for channel in pipeline.channels[: pipeline.channel_count]
    }
    meant = {name.encode(): (layout.width, PIXEL_BYTES[kind], 1, 1) for name, kind in layout.channels.items()}
    return list(found.items()) == sorted(meant.items())


class _Targets:
    """Where the channels of a pipeline go, by a few steps a chunk: all of them hold the interpreter."""

    def __init__(self, pipeline: _Pipeline, places: Sequence[_Place | None]) -> None:
        self._wanted: list[tuple[_Channel, _Place]] = []
        for channel, place in zip(pipeline.channels[: pipeline.channel_count], places, strict=True):
            if place is not None:
                channel.user_bytes_per_element, channel.user_data_type = NUMBER, place.kind
                channel.user_pixel_stride, channel.user_line_stride = NUMBER, place.line
                self._wanted.append((channel, place))

    def set(self, row: int) -> bool:
        """Let the chunk from ``row`` on go there; False where the library did not keep what it was told before."""
        for channel, place in self._wanted:
            if channel.user_line_stride != place.line:
                return False
            channel.decode_to_ptr = place.address + row * place.line
        return True
