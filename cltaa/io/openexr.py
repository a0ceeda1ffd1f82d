"""The OpenEXR module as it is used here: its threads and limits in a process of our own, and its output muted.

Its Python module prints warnings on standard output, through Python, and its C library prints errors on standard error,
through the C library's own stream, two lines for a damaged file; neither can be turned off. In other programs nothing
is muted.
"""

from __future__ import annotations

import ctypes
import os
import platform
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, TextIO

import OpenEXR

from cltaa.io.exr_header import LARGEST_SIDE
from cltaa.process import CORES, MANY_CORES, is_own, once_own

__all__ = ["OpenEXR", "muted_output"]


def _configure() -> None:
    # OpenEXR starts with no worker threads and no limit; a second core halves the time of ZIP. Of many cores half are
    # left to other work: with all of them each frame is decoded sooner, and everything else waits for it.
    OpenEXR.set_global_thread_count(min(CORES, max(MANY_CORES, CORES // 2)))
    OpenEXR.setMaxImageSize(LARGEST_SIDE, LARGEST_SIDE)


once_own(_configure)


class _StandardOutput:
    """Standard output that drops the text of some threads and passes on that of all others."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        self.muted: set[int] = set()

    def write(self, text: str) -> int:
        return len(text) if threading.get_ident() in self.muted else self.stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


class _Complaints:
    """The variable ``stderr`` of the C library, which C code prints to and Python does not."""

    def __init__(self) -> None:
        self._silent: int | None = None
        if platform.libc_ver()[0] != "glibc":  # in other C libraries the variable is a constant
            return
        library = ctypes.CDLL(None)
        library.fopen.restype = ctypes.c_void_p
        self._stream = ctypes.c_void_p.in_dll(library, "stderr")
        self._loud, self._silent = self._stream.value, library.fopen(os.devnull.encode(), b"w")

    def mute(self, on: bool) -> None:
        """Point it to the null device, or back to where it pointed."""
        if self._silent:
            self._stream.value = self._silent if on else self._loud


_lock = threading.Lock()
_output: _StandardOutput | None = None
# Every instance ever installed: CPython's print holds no reference to sys.stdout while it writes, so freeing one during
# another thread's print would crash the process.
_made: list[_StandardOutput] = []


@contextmanager
def muted_output() -> Iterator[None]:
    """Drop what this thread prints to ``sys.stdout`` and what C code of any thread prints to ``stderr``.

    Other threads, such as a progress display, keep both ``sys.stdout`` and ``sys.stderr``. A redirection of the file
    descriptors, or of ``sys.stdout`` by each thread for itself, would drop their text too and could be undone in the
    wrong order; here the last thread to leave restores the streams. In a process of another program nothing is muted.
    """
    global _output
    if not is_own():
        yield
        return
    thread = threading.get_ident()
    with _lock:
        if _output is None:
            _output = sys.stdout = _around(sys.stdout)
            _complaints().mute(True)
        _output.muted.add(thread)
    try:
        yield
    finally:
        with _lock:
            _output.muted.discard(thread)
            if not _output.muted:
                if sys.stdout is _output:
                    sys.stdout = _output.stream
                _output = None
                _complaints().mute(False)


def _around(stream: TextIO) -> _StandardOutput:
    for made in _made:
        if made.stream is stream:
            return made
    _made.append(_StandardOutput(stream))
    return _made[-1]


_complaints = cache(_Complaints)
