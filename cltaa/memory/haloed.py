"""Images in memory that lies as the planes of a device do, with a halo around them: a device that shares the host's
memory reads them where they are, and nothing is copied."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cltaa.memory.allocator import Block, mapped_image
from cltaa.memory.layout import Layout


def empty_haloed(count: int, height: int, width: int) -> NDArray[np.float32]:
    """Planes [count, H, W], not filled, inside of memory with a halo."""
    layout = Layout(width, height)
    inside: NDArray[np.float32] = layout.inside(mapped_image((count, layout.rows, layout.stride)))
    return inside


def haloed(planes: Sequence[NDArray[np.generic]]) -> NDArray[np.float32]:
    """Copies of planes [H, W] as float32 [planes, H, W], inside of memory with a halo that is not filled."""
    copies = empty_haloed(len(planes), *planes[0].shape)
    for copy, plane in zip(copies, planes, strict=True):
        copy[...] = plane
    return copies


def around(planes: NDArray[np.float32], layout: Layout) -> NDArray[np.float32] | None:
    """The planes [C, rows, stride] of ``layout`` that ``planes`` [C, H, W] are the inside of.

    None where they are not all that ``haloed`` made for an image of that size: rows of it, or memory of another kind.
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
