"""Pixels decoded to where they are wanted, by the C library inside of OpenEXR's Python module.

The module allocates what it decodes, thousands of page faults a frame, and it has to be moved from there. OpenEXRCore,
which it is made of, decodes into any memory, and only those channels and parts that are wanted. What is not decoded
here is the module's to decode, and to say what is wrong: damaged files, a library of another version or without these
functions.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from ctypes import CDLL, PyDLL, byref, c_char_p, c_int, c_void_p, sizeof
from functools import cache
from itertools import product
from typing import Any, NamedTuple

from numpy.typing import NDArray

from cltaa.exr.core_structures import Channel, Chunk, Pipeline
from cltaa.io.content import Copy
from cltaa.io.exr_layout import PIXEL_BYTES, Layout
from cltaa.io.openexr import OpenEXR
from cltaa.io.quiet import muted_output

VERSION = (3, 5)  # of the library: the first two numbers
FUNCTIONS = (
    "start_read",
    "finish",
    "read_scanline_chunk_info",
    "read_tile_chunk_info",
    "decoding_initialize",
    "decoding_choose_default_routines",
    "decoding_update",
    "decoding_run",
    "decoding_destroy",
)
TYPES = {"uint32": 0, "float16": 1, "float32": 2}  # the library's numbers of that


class _Core(NamedTuple):
    """The library twice: what takes long lets other threads use the interpreter, what is quick takes no turn for it."""

    long: CDLL
    quick: PyDLL


class _Place(NamedTuple):
    """Where a channel goes: its first number, bytes of each and from row to row, the library's number of its type."""

    address: int
    size: int
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
    """A part of a file, and of each of its channels, in their order, where it goes, if anywhere."""

    def __init__(self, file: _File, layout: Layout, part: int, planes: Mapping[str, NDArray[Any]]) -> None:
        self.file, self.layout, self.part = file, layout, part
        self._planes = planes  # which are there until all threads have ended
        self.places = [self._place(name) for name in sorted(layout.channels, key=str.encode)]

    def _place(self, name: str) -> _Place | None:
        if name not in self._planes:
            return None
        plane = self._planes[name]
        line, step = plane.strides
        if step != plane.itemsize or plane.shape != (self.layout.height, self.layout.width):
            raise ValueError("a plane has numbers side by side, as many as the picture")
        return _Place(plane.ctypes.data, step, line, TYPES[plane.dtype.name])

    @property
    def corners(self) -> list[tuple[int, int]]:
        """Row and column of the first pixel of each chunk."""
        width, height = self.layout.chunk
        return list(product(range(0, self.layout.height, height), range(0, self.layout.width, width)))

    def find(self, row: int, column: int, chunk: Chunk) -> bool:
        """Read of the chunk that begins there where it stands; False where the library means other pixels by it."""
        layout, quick = self.layout, self.file.core.quick
        width, height = layout.chunk
        if layout.tile is None:
            start = layout.data_window[0], layout.data_window[1] + row
            failed = quick.exr_read_scanline_chunk_info(self.file.context, self.part, start[1], byref(chunk))
        else:
            start = column // width, row // height
            failed = quick.exr_read_tile_chunk_info(self.file.context, self.part, *start, 0, 0, byref(chunk))
        meant = (*start, min(width, layout.width - column), min(height, layout.height - row))
        return not failed and (chunk.start_x, chunk.start_y, chunk.width, chunk.height) == meant


@cache
def core() -> _Core | None:
    """The library, or None where it is not that of ``VERSION`` or cannot be reached."""
    try:
        found = _Core(CDLL(OpenEXR.__file__), PyDLL(OpenEXR.__file__))
        major, minor, patch, extra = c_int(), c_int(), c_int(), c_char_p()
        found.long.exr_get_library_version(byref(major), byref(minor), byref(patch), byref(extra))
        for name in FUNCTIONS:
            getattr(found.quick, f"exr_{name}")
    except (OSError, AttributeError, TypeError):
        return None
    return found if (major.value, minor.value) == VERSION and sizeof(c_void_p) == 8 else None


def decode(content: Copy, layout: Layout, planes: Mapping[str, NDArray[Any]], *, part: int = 0) -> bool:
    """Decode channels of a part into ``planes`` [H, W] of float32, float16 or uint32, rows apart as one likes.

    ``layout`` is that of the part, and was checked. Other channels are left out; halves are widened for float32. False
    where the planes are not, or not all, filled.
    """
    library = core()
    if library is None:
        return False
    with muted_output():
        file = _File(library, content)
        return not file.failed and _in_threads(_Picture(file, layout, part, planes))


def _in_threads(picture: _Picture) -> bool:
    """Decode all chunks in as many threads as OpenEXR has; True where each of them is there."""
    corners = picture.corners
    left, count = iter(corners), min(OpenEXR.global_thread_count(), len(corners))  # each thread takes the next
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


def _decode(picture: _Picture, left: Iterator[tuple[int, int]]) -> bool:
    """Decode the chunks that begin at the pixels that are ``left``, with one pipeline."""
    (long, quick), context, part = picture.file.core, picture.file.context, picture.part
    chunk, pipeline, begun = Chunk(), Pipeline(pipe_size=sizeof(Pipeline)), False
    both = (context, part, byref(chunk), byref(pipeline))
    targets: _Targets | None = None
    try:
        for row, column in left:
            if not picture.find(row, column, chunk):
                return False
            if (quick.exr_decoding_update if begun else quick.exr_decoding_initialize)(*both):
                return False
            first, begun = targets is None, True
            if targets is None:
                if not _understood(pipeline, chunk, picture.layout):
                    return False
                targets = _Targets(pipeline, picture.places)
            if not targets.set(row, column):
                return False
            if first and quick.exr_decoding_choose_default_routines(context, part, both[3]):
                return False
            if long.exr_decoding_run(context, part, both[3]):
                return False
        return True
    finally:
        if begun:
            quick.exr_decoding_destroy(context, both[3])


def _understood(pipeline: Pipeline, chunk: Chunk, layout: Layout) -> bool:
    """True where the library and this module mean the same channels, at the same places of their structures."""
    found = {
        channel.channel_name: (channel.width, channel.bytes_per_element, channel.x_samples, channel.y_samples)
        for channel in pipeline.channels[: pipeline.channel_count]
    }
    meant = {name.encode(): (chunk.width, PIXEL_BYTES[kind], 1, 1) for name, kind in layout.channels.items()}
    return list(found.items()) == sorted(meant.items())


class _Targets:
    """Where the channels of a pipeline go, by a few steps a chunk: all of them hold the interpreter."""

    def __init__(self, pipeline: Pipeline, places: Sequence[_Place | None]) -> None:
        self._wanted: list[tuple[Channel, _Place]] = []
        for channel, place in zip(pipeline.channels[: pipeline.channel_count], places, strict=True):
            if place is not None:
                channel.user_bytes_per_element, channel.user_data_type = place.size, place.kind
                channel.user_pixel_stride, channel.user_line_stride = place.size, place.line
                self._wanted.append((channel, place))

    def set(self, row: int, column: int) -> bool:
        """Let the chunk from there on go there; False where the library did not keep what it was told before."""
        for channel, place in self._wanted:
            if channel.user_line_stride != place.line:
                return False
            channel.decode_to_ptr = place.address + row * place.line + column * place.size
        return True
