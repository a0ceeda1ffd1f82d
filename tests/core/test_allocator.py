"""Which blocks a run keeps in the heap, which it maps, and images in the memory of earlier ones."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from cltaa.core.planes import (
    KEPT_BLOCKS,
    LARGEST,
    SMALLEST,
    empty_image,
    kept_memory,
    mapped_from,
)


@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (2048, 1152), (3840, 2160), (7680, 4320), (16384, 16384)])
def test_planes_are_mapped_and_what_a_chunk_takes_is_not(width: int, height: int) -> None:
    """40 frames of 1920 x 1080 with planes in the heap took 780 MB where 588 were told; with planes mapped 584."""
    plane, rows_of_a_chunk, channels = 4 * width * height, 16, 8
    assert 4 * width * rows_of_a_chunk * channels <= mapped_from(plane) < plane


@pytest.mark.parametrize(("plane", "expected"), [(1, SMALLEST), (3 * SMALLEST, 3 * SMALLEST // 2), (2**40, LARGEST)])
def test_the_limit_goes_with_the_planes_between_two_ends(plane: int, expected: int) -> None:
    assert mapped_from(plane) == expected


IMAGE = (3, 1024, 1024)  # large enough to be kept


def test_an_image_lies_where_one_of_its_size_was() -> None:
    with kept_memory(IMAGE[1] * IMAGE[2] * 4):
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
    with kept_memory(4, images=False):
        empty_image(shape)[...] = 1.0
        assert KEPT_BLOCKS.take(12 * 2**20) is None
    with kept_memory(4):
        empty_image(shape)[...] = 1.0
    assert KEPT_BLOCKS.take(12 * 2**20) is None


def test_an_image_that_no_memory_is_there_for() -> None:
    with pytest.raises(MemoryError):
        empty_image((1 << 30, 1 << 30))


def test_images_of_many_threads_are_their_own() -> None:
    def fill(number: int) -> bool:
        image = empty_image(IMAGE)
        image[...] = number
        return bool((image == number).all())

    with kept_memory(4 * IMAGE[1] * IMAGE[2]), ThreadPoolExecutor(4) as threads:
        assert all(threads.map(fill, range(40)))
