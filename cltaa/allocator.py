"""Memory of a long run: what a frame leaves is what the next one takes."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

# glibc's mallopt, malloc.h: which parameter, and the value for frames that come and go in several threads.
M_TRIM_THRESHOLD, KEPT = -1, 2**31 - 1  # bytes: free memory at the end of the heap that is not given back
M_MMAP_THRESHOLD = -3  # bytes: blocks from this size on are mapped on their own
SMALLEST, LARGEST = 8 * 2**20, 32 * 2**20  # bytes, of that threshold; glibc takes no more
M_ARENA_MAX, ARENAS = -8, 1  # one heap for all threads: frames are made in one thread and freed in another


@contextmanager
def kept_memory(plane_bytes: int) -> Iterator[None]:
    """Keep freed blocks of up to the size of a plane for what is allocated next; all goes back at the end.

    By itself glibc maps and unmaps the planes of every frame, which for 1920 x 1080 are thousands of page faults, and
    each unmapping halts all threads of the process. Blocks of several planes are mapped, in large pages, because in the
    heap they would leave gaps that only some of them fit. Does nothing with other C libraries than glibc.
    """
    library = ctypes.CDLL(None)
    if not hasattr(library, "mallopt"):
        yield
        return
    threshold = min(max(plane_bytes * 3 // 2, SMALLEST), LARGEST)
    for parameter, value in ((M_TRIM_THRESHOLD, KEPT), (M_MMAP_THRESHOLD, threshold), (M_ARENA_MAX, ARENAS)):
        library.mallopt(parameter, value)
    try:
        yield
    finally:
        library.malloc_trim(0)
