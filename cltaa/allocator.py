"""Memory of a long run: what a frame leaves is what the next one takes."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

# glibc's mallopt, malloc.h: which parameter, and the value for frames that come and go in several threads.
M_TRIM_THRESHOLD, KEPT = -1, 2**31 - 1  # bytes: free memory at the end of the heap that is not given back
M_MMAP_THRESHOLD = -3  # bytes: blocks from this size on are mapped on their own
SMALLEST, LARGEST = 4 * 2**20, 32 * 2**20  # bytes, of that threshold: NumPy's for large pages; glibc takes no more
M_ARENA_MAX, ARENAS = -8, 1  # one heap for all threads: frames are made in one thread and freed in another


@contextmanager
def kept_memory(plane_bytes: int) -> Iterator[None]:
    """Keep freed blocks of up to half a plane for what is allocated next; all goes back at the end.

    By itself glibc maps and unmaps every block from 256 kB on, OpenEXR's of each chunk too: thousands of page faults a
    frame of 1920 x 1080, and each unmapping halts all threads of the process. Planes are mapped, in large pages,
    because in the heap, among what is small, they would leave gaps that nothing fits. Does nothing with other C
    libraries than glibc.
    """
    library = ctypes.CDLL(None)
    if not hasattr(library, "mallopt"):
        yield
        return
    threshold = mapped_from(plane_bytes)
    for parameter, value in ((M_TRIM_THRESHOLD, KEPT), (M_MMAP_THRESHOLD, threshold), (M_ARENA_MAX, ARENAS)):
        library.mallopt(parameter, value)
    try:
        yield
    finally:
        library.malloc_trim(0)


def mapped_from(plane_bytes: int) -> int:
    """Bytes from which on blocks are mapped on their own, in a run over images with planes of that size."""
    return min(max(plane_bytes // 2, SMALLEST), LARGEST)
