"""Padded planes in memory: their layout, a pool of them, and images that already have it, which need no copy."""

from __future__ import annotations

import mmap
import threading
from collections import deque
from collections.abc import Hashable, Sequence
from contextlib import suppress
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from cltaa.core.constants import PAD_X, PAD_Y, ROW_ALIGNMENT
from cltaa.errors import UsageError
from cltaa.frame import Frame, on_device, writable

Plane = NDArray[Any]


def as_floats(array: NDArray[Any], *, copy: bool = False) -> NDArray[np.float32]:
    """Round to floats; doubles beyond those become infinite, which counts as missing, without NumPy's warning."""
    with np.errstate(over="ignore"):
        return array.astype(np.float32, order="C" if copy else "K", subok=False, copy=copy)


class Layout(NamedTuple):
    """Size of an image and of the planes that hold it, in texels."""

    width: int
    height: int

    @property
    def stride(self) -> int:
        """Texels from one row to the next."""
        return -(-self.width // ROW_ALIGNMENT) * ROW_ALIGNMENT + 2 * PAD_X

    @property
    def rows(self) -> int:
        """Rows of a plane, halo included."""
        return self.height + 2 * PAD_Y

    @property
    def plane(self) -> int:
        """Texels of a plane."""
        return self.stride * self.rows

    @property
    def held(self) -> slice:
        """Rows of a plane that hold rows of the image."""
        return slice(PAD_Y, PAD_Y + self.height)

    def inside(self, planes: Plane) -> Plane:
        """View of the image inside ``planes`` [..., rows, stride] -> [..., height, width]."""
        return planes[..., self.held, PAD_X : PAD_X + self.width]

    def extend_edges(self, planes: Plane) -> None:
        """Repeat the edge of ``planes`` [..., rows, stride] into the halo, in place."""
        first_row, last_row, last_column = self.held.start, self.held.stop - 1, PAD_X + self.width - 1
        image = planes[..., self.held, :]
        image[..., :PAD_X] = image[..., PAD_X : PAD_X + 1]
        image[..., last_column + 1 :] = image[..., last_column : last_column + 1]
        planes[..., :first_row, :] = planes[..., first_row : first_row + 1, :]
        planes[..., last_row + 1 :, :] = planes[..., last_row : last_row + 1, :]

    def zeros(self, planes: int, dtype: Any = np.float32) -> Plane:
        """``planes`` planes of zeros, [planes, rows, stride]."""
        return np.zeros((planes, self.rows, self.stride), dtype)


SMALLEST = 4 * 2**20  # bytes from which on images are pooled: those from which NumPy asks for large pages
LARGE_PAGE = 2 * 2**20  # bytes; the system starts a mapping of a multiple of it at a large page


class BlockPool:
    """Memory that frames have released, by its kind: all of it in a ``with`` block, or always up to ``most`` of a kind.

    Otherwise each piece is mapped and unmapped: page faults, and each unmapping halts all threads of the process.
    """

    def __init__(self, most: int = 0) -> None:
        self._lock, self._users, self._left = threading.Lock(), 0, dict[Hashable, deque[Any]]()
        self._most = most

    def __reduce__(self) -> tuple[type[BlockPool], tuple[int]]:
        """A copy starts empty: only those that share a pool reuse its memory."""
        return BlockPool, (self._most,)

    def __enter__(self) -> None:
        """Start to keep released memory."""
        with self._lock:
            self._users += 1

    def __exit__(self, *_: object) -> None:
        """Free everything, unless another user is inside."""
        with self._lock:
            self._users -= 1
            if not self._users:
                self._left.clear()

    def take(self, kind: Hashable) -> Any | None:
        """Return what was last left of that kind, or None."""
        with suppress(KeyError, IndexError):
            return self._left[kind].pop()
        return None

    def leave(self, kind: Hashable, block: object) -> None:
        """Keep what is no longer needed; takes no lock, because it may run wherever an array is freed."""
        if self._users or self._most:
            self._left.setdefault(kind, deque(maxlen=self._most or None)).append(block)


BLOCK_POOL = BlockPool()  # of ``empty_image`` and of copies of files


def empty_image(
    shape: tuple[int, ...], dtype: type[np.floating[Any]] = np.float32, pool: BlockPool = BLOCK_POOL
) -> NDArray[Any]:
    """Return planes like those of ``np.empty``, in memory that earlier ones of the same size left in ``pool``."""
    small = np.dtype(dtype).itemsize * int(np.prod(shape)) < SMALLEST
    return np.empty(shape, dtype) if small else mapped_image(shape, dtype, pool)


def empty_result(
    frame: Frame, dtype: type[np.floating[Any]], *, planar: bool = False, pool: BlockPool = BLOCK_POOL
) -> NDArray[Any]:
    """Return memory for the result of ``frame``, [H, W, 3 or 4]; ``planar`` stores each channel by itself."""
    height, width, channels = result_shape(frame)
    if planar:
        return np.moveaxis(empty_image((channels, height, width), dtype, pool), 0, -1)
    return empty_image((height, width, channels), dtype, pool)


def result_shape(frame: Frame) -> tuple[int, int, int]:
    """Return rows, columns and channels of the result of ``frame``."""
    return frame.height, frame.width, 3 if frame.alpha is None else 4


class Kind(IntEnum):
    """How the numbers of an array are converted (``kernels/arrays.cl``)."""

    AS_IT_IS = 0
    PERSPECTIVE = 1  # distances to inverse depth, 1/Z
    PARALLEL = 2  # the same for an orthographic camera, -Z


def places(array: Any) -> dict[str, int]:
    """Return how an array [H, W] or [H, W, C] of floats or halves lies in memory, as kernel arguments."""
    item, strides = array.dtype.itemsize, array.strides
    return {
        "first": array.offset // item if on_device(array) else 0,  # the offset of a memmap is one in its file
        "row_step": strides[0] // item,
        "column_step": strides[1] // item,
        "plane_step": strides[2] // item if len(strides) > 2 else 0,
        "halves": int(item == 2),
    }


def flat(array: NDArray[Any], *, dense: bool = False) -> NDArray[Any] | None:
    """Return the memory of an array, from its first number to its last, or None where kernels cannot read it there.

    It has another type or negative strides, or is less than half of that memory, or with ``dense`` less than all.
    """
    if array.dtype not in (np.float32, np.float16) or not array.dtype.isnative or not array.flags.aligned:
        return None
    if array.flags.c_contiguous:
        return np.asarray(array).reshape(-1)
    item = array.itemsize
    steps = [step // item for step in array.strides]
    if min(steps) < 0 or any(step % item for step in array.strides):
        return None
    length = 1 + sum(step * (count - 1) for step, count in zip(steps, array.shape, strict=True))
    if length > 2 * array.size or (dense and (length != array.size or 0 in steps)):
        return None
    return as_strided(array, (length,), (item,))


def checked_layout(width: int, height: int) -> Layout:
    """Return the layout of frames of a size; raises UsageError for no pixel."""
    if width < 1 or height < 1:
        raise UsageError("no size of frames", expected="width and height from 1 on", found=f"{width} x {height}")
    return Layout(width, height)


def checked_out(out: Any, frame: Frame, *, half: bool = False) -> Any:
    """Return ``out``, or NumPy's array of its memory, if it can hold the result of ``frame``; else raises UsageError,
    and DataError for memory that cannot be shared."""
    shape, out = result_shape(frame), writable(out)
    is_array = isinstance(out, np.ndarray) or on_device(out)
    if not is_array or out.shape != shape or out.dtype not in (np.float32, np.float16):
        found = f"{out.dtype} {out.shape}" if is_array else type(out).__name__
        raise UsageError("out cannot hold the result", expected=f"float32 or float16 {shape}", found=found)
    if half and out.dtype != np.float16:
        raise UsageError("half=True, but out holds float32", cure="leave half out: the type of out counts")
    if isinstance(out, np.ndarray) and not out.flags.writeable:
        raise UsageError("out cannot be written to", cure="give an array of your own")
    return out


def may_overlap(one: Any, other: Any) -> bool:
    """True where two arrays of the host may share memory."""
    return isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and np.may_share_memory(one, other)


def mapped_image(
    shape: tuple[int, ...], dtype: type[np.floating[Any]] = np.float32, pool: BlockPool = BLOCK_POOL
) -> NDArray[Any]:
    """As ``empty_image``, of any size, in a mapping of its own, which begins at a page."""
    count = int(np.prod(shape))
    pages = in_large_pages(np.dtype(dtype).itemsize * count)
    block = Block(pool.take(pages) or _mapped(pages, pages), pool)
    return np.asarray(block).view(dtype)[:count].reshape(shape)


def bytes_in_large_pages(size: int) -> NDArray[np.uint8]:
    """Return bytes in a mapping of their own, in as many large pages as they fill: no more memory than their size."""
    return np.frombuffer(_mapped(in_large_pages(size), size // LARGE_PAGE * LARGE_PAGE), np.uint8)[:size]


def in_large_pages(size: int) -> int:
    """Return the bytes of a mapping of large pages that holds ``size``."""
    return -(-size // LARGE_PAGE) * LARGE_PAGE


def _mapped(size: int, large: int) -> mmap.mmap:
    """Return a mapping of ``size`` bytes, the first ``large`` of them in large pages."""
    try:
        memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as error:
        raise MemoryError(f"no {size} bytes") from error
    if hasattr(mmap, "MADV_HUGEPAGE") and large:
        memory.madvise(mmap.MADV_HUGEPAGE, 0, large)
    return memory


class Block:
    """Owner of a piece of memory, to which arrays over it refer; the last of them releases it."""

    def __init__(self, memory: mmap.mmap, pool: BlockPool) -> None:
        self._memory, self._pool = memory, pool
        address = np.frombuffer(memory, np.uint8).ctypes.data
        self.__array_interface__ = {
            "data": (address, False),
            "shape": (len(memory) // 4,),
            "typestr": "<f4",
            "version": 3,
        }

    def __del__(self) -> None:
        """Leave the memory to the next allocation."""
        self._pool.leave(len(self._memory), self._memory)


def empty_haloed(count: int, height: int, width: int) -> NDArray[np.float32]:
    """Return planes [count, H, W], not filled, inside of memory with a halo."""
    layout = Layout(width, height)
    inside: NDArray[np.float32] = layout.inside(mapped_image((count, layout.rows, layout.stride)))
    return inside


def haloed(planes: Sequence[NDArray[np.generic]]) -> NDArray[np.float32]:
    """Return copies of planes [H, W] as float32 [planes, H, W], inside of memory with a halo that is not filled."""
    copies = empty_haloed(len(planes), *planes[0].shape)
    for copy, plane in zip(copies, planes, strict=True):
        copy[...] = plane
    return copies


def around(planes: NDArray[np.float32], layout: Layout) -> NDArray[np.float32] | None:
    """Return the planes [C, rows, stride] of ``layout`` of which ``planes`` [C, H, W] are the inside.

    None unless those are all that ``haloed`` made for an image of that size: not some rows of it, nor other memory.
    """
    lies: object = planes
    while isinstance(lies, np.ndarray):
        whole, lies = lies, lies.base
    shape, size = (len(planes), layout.rows, layout.stride), (layout.height, layout.width)
    if not isinstance(lies, Block) or whole.size < np.prod(shape) or planes.shape[1:] != size:
        return None
    whole = whole[: np.prod(shape)].reshape(shape)
    return whole if _place(layout.inside(whole)) == _place(planes) else None


def _place(planes: NDArray[np.float32]) -> tuple[object, ...]:
    steps = [step for step, length in zip(planes.strides, planes.shape, strict=True) if length > 1]
    return planes.ctypes.data, planes.shape, steps, planes.dtype
