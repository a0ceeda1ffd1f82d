"""Memory of a long run: frames go back to the system as soon as they are dropped."""

from __future__ import annotations

import ctypes

# glibc's mallopt, malloc.h: which parameter, and the value for frames that come and go in several threads.
M_MMAP_THRESHOLD, LARGE = -3, 256 * 1024  # bytes: larger blocks are mapped on their own and unmapped when freed
M_ARENA_MAX, ARENAS = -8, 1  # one heap for all threads: frames are made in one thread and freed in another


def return_freed_frames() -> None:
    """Keep glibc from collecting freed frames in its heaps, whose size would then depend on the length of a run.

    By itself it raises its threshold to the size of a frame after the first one is freed. Does nothing elsewhere.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, LARGE)
        mallopt(M_ARENA_MAX, ARENAS)
