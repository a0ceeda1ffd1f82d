"""The cores that this process may use, and work on the rows of an image by several of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache

CORES, MANY_CORES = len(os.sched_getaffinity(0)), 8
THREADS = 4 if CORES >= MANY_CORES else 1  # that work on an image: memory gives no more of them anything
FEWEST_ROWS = 64  # a thread: less is done before the others are awake


def in_rows(height: int, work: Callable[[slice], object]) -> None:
    """Call ``work`` for all rows of an image, in parts by threads beside this one; raises what it raises."""
    count = min(THREADS, height // FEWEST_ROWS)
    if count < 2:
        work(slice(0, height))
        return
    step = -(-height // count)
    first, *others = (slice(start, min(start + step, height)) for start in range(0, height, step))
    begun = [_threads().submit(work, rows) for rows in others]
    try:
        work(first)
    finally:
        wait(begun)  # before the memory that they work on is somebody else's
    for part in begun:
        part.result()


@cache
def _threads() -> ThreadPoolExecutor:
    """There until the program ends."""
    return ThreadPoolExecutor(THREADS - 1, "rows")
