"""Images in the memory of earlier ones, during a run and not outside of it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from cltaa.core.planes import BLOCK_POOL, empty_image

IMAGE = (3, 1024, 1024)  # large enough to be kept


def test_an_image_lies_where_one_of_its_size_was() -> None:
    with BLOCK_POOL:
        first = empty_image(IMAGE)
        first[...] = 1.0
        address, view = first.ctypes.data, first[1, 2:]
        del first
        second = empty_image(IMAGE)
        second[...] = 2.0
        assert second.ctypes.data != address  # a view of the first is there still
        assert (view == 1.0).all()
        del view
        assert empty_image(IMAGE).ctypes.data == address
        assert second.shape == IMAGE
        assert second.dtype == np.float32
        assert second.flags.c_contiguous
        assert second.flags.writeable


@pytest.mark.parametrize("shape", [(3, 8, 8), IMAGE])
def test_outside_of_a_run_nothing_is_kept(shape: tuple[int, ...]) -> None:
    empty_image(shape)[...] = 1.0
    assert BLOCK_POOL.take(12 * 2**20) is None
    with BLOCK_POOL:
        empty_image(shape)[...] = 1.0
    assert BLOCK_POOL.take(12 * 2**20) is None


def test_an_image_that_no_memory_is_there_for() -> None:
    with pytest.raises(MemoryError):
        empty_image((1 << 30, 1 << 30))


def test_images_of_many_threads_are_their_own() -> None:
    def fill(number: int) -> bool:
        image = empty_image(IMAGE)
        image[...] = number
        return bool((image == number).all())

    with BLOCK_POOL, ThreadPoolExecutor(4) as threads:
        assert all(threads.map(fill, range(40)))
