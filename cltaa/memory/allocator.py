"""Memory of a long run: what a frame leaves is what the next one takes."""

from __future__ import annotations

import mmap
import threading
from collections import deque
from collections.abc import Hashable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

SMALLEST = 4 * 2**20  # bytes from which on images are kept: NumPy's, for large pages
LARGE_PAGE = 2 * 2**20  # bytes; the system begins a mapping of a multiple of it at one


@contextmanager
def kept_memory(*, images: bool = True) -> Iterator[None]:
    """Keep what ``empty_image`` and copies of files leave for those that come next; all goes back at the end.

    Else each is mapped and unmapped: page faults, and each unmapping halts all threads of the process. Without
    ``images`` nothing is kept.
    """
    with KEPT_BLOCKS if images else nullcontext():
        yield


class KeptBlocks:
    """What frames have left, by its kind, while somebody is inside of ``kept_memory``."""

    def __init__(self) -> None:
        self._lock, self._users, self._left = threading.Lock(), 0, dict[Hashable, deque[Any]]()

    def __enter__(self) -> None:
        """Begin to keep."""
        with self._lock:
            self._users += 1

    def __exit__(self, *_: object) -> None:
        """Give everything back, where nobody else is inside."""
        with self._lock:
            self._users -= 1
            if not self._users:
                self._left.clear()

    def take(self, kind: Hashable) -> Any | None:
        """What was left of that kind last, or None."""
        with suppress(KeyError, IndexError):
            return self._left[kind].pop()
        return None

    def leave(self, kind: Hashable, block: object) -> None:
        """Keep what is not needed any more; takes no lock, since it may be called wherever an array ends."""
        if self._users:
            self._left.setdefault(kind, deque()).append(block)


KEPT_BLOCKS = KeptBlocks()


def empty_image(shape: tuple[int, ...], dtype: type[np.floating[Any]] = np.float32) -> NDArray[Any]:
    """Planes like those of ``np.empty``, inside ``kept_memory`` in what earlier ones of the same size have left."""
    small = np.dtype(dtype).itemsize * int(np.prod(shape)) < SMALLEST
    return np.empty(shape, dtype) if small else mapped_image(shape, dtype)


def mapped_image(shape: tuple[int, ...], dtype: type[np.floating[Any]] = np.float32) -> NDArray[Any]:
    """The same of any size in a mapping of its own, which begins at a page."""
    count = int(np.prod(shape))
    pages = in_large_pages(np.dtype(dtype).itemsize * count)
    return np.asarray(Block(KEPT_BLOCKS.take(pages) or _mapped(pages, pages))).view(dtype)[:count].reshape(shape)


def bytes_in_large_pages(size: int) -> NDArray[np.uint8]:
    """Bytes in a mapping of their own, in as many large pages as they fill: no more memory than they are."""
    return np.frombuffer(_mapped(in_large_pages(size), size // LARGE_PAGE * LARGE_PAGE), np.uint8)[:size]


def in_large_pages(size: int) -> int:
    """Bytes that a mapping for ``size`` of them takes."""
    return -(-size // LARGE_PAGE) * LARGE_PAGE


def _mapped(size: int, large: int) -> mmap.mmap:
    """A mapping of ``size`` bytes, the first ``large`` of them in large pages."""
    try:
        memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as error:
        raise MemoryError(f"no {size} bytes") from error
    if hasattr(mmap, "MADV_HUGEPAGE") and large:
        memory.madvise(mmap.MADV_HUGEPAGE, 0, large)
    return memory


class Block:
    """What arrays over a piece of memory refer to; with the last of them the memory is free."""

    def __init__(self, memory: mmap.mmap) -> None:
        self._memory = memory
        address = np.frombuffer(memory, np.uint8).ctypes.data
        self.__array_interface__ = {
            "data": (address, False),
            "shape": (len(memory) // 4,),
            "typestr": "<f4",
            "version": 3,
        }

    def __del__(self) -> None:
        """Leave it to what is allocated next."""
        KEPT_BLOCKS.leave(len(self._memory), self._memory)
