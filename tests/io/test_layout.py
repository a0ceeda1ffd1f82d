"""Windows of data and display that begin anywhere, and what a layout says of them."""

from __future__ import annotations

from pathlib import Path

from cltaa.io.exr_layout import Layout, Window, covers

DISPLAY = (100, 200, 163, 247)  # 64 x 48


def layout(data: Window) -> Layout:
    return Layout(Path("a.exr"), {"R": "half", "id": "uint"}, data, DISPLAY, "zip")


def test_a_region_is_counted_from_the_first_pixel_of_the_display_window() -> None:
    picture = layout((110, 205, 119, 224))
    assert picture.region == (10, 5, 19, 24)
    assert picture.cropped((11, 6, 12, 9)).data_window == (111, 206, 112, 209)
    assert picture.cropped((11, 6, 12, 9)).region == (11, 6, 12, 9)
    assert picture.size == "10 x 20 at (10, 5) of 64 x 48"
    assert (picture.decoded_bytes, picture.chunk_bytes) == (10 * 20 * 6, 10 * 16 * 6)


def test_a_picture_covers_what_lies_in_it() -> None:
    for region, covered in [
        ((10, 5, 19, 24), True),
        ((9, 5, 19, 24), False),
        ((10, 4, 19, 24), False),
        ((10, 5, 20, 24), False),
        ((10, 5, 19, 25), False),
    ]:
        assert covers(layout((110, 205, 119, 224)).region, region) is covered, region
