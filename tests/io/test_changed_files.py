"""A file that is replaced after its sequence was opened is refused, not cropped or padded to the earlier picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cltaa.errors import DataError
from cltaa.inputs.open import open_input
from cltaa.io.exr_frame import frame_attributes, frame_planes
from cltaa.io.exr_write import write_frame, write_image
from cltaa.io.sequence import open_images
from tests.sequence_factory import make_frame, write_sequence

SAID = r"synthetic\.0001\.exr: the file changed after the sequence was opened \(expected 9 x 7, found {}\); run again"


def in_window(folder: Path, number: int, first: int, columns: int) -> None:
    """Write a frame whose data window has some columns of its 9."""
    frame = make_frame(number, width=9, height=7, effects=None)
    planes = {name: plane[:, first : first + columns].copy() for name, plane in frame_planes(frame, folder).items()}
    windows = ((first, 0, first + columns - 1, 6), (0, 0, 8, 6))
    write_image(folder / f"synthetic.{number:04d}.exr", planes, frame_attributes(frame), windows=windows)


@pytest.mark.parametrize("told", [{}, {"assignments": ["depth.scale=1"]}], ids=["own", "another tool's"])
@pytest.mark.parametrize("size", [(12, 10), (5, 4)], ids=["larger", "smaller"])
def test_another_size_is_refused(tmp_path: Path, told: dict[str, Any], size: tuple[int, int]) -> None:
    sequence = open_input(write_sequence(tmp_path, 2, width=9, height=7), **told)
    write_frame(tmp_path / "synthetic.0001.exr", make_frame(1, width=size[0], height=size[1]))
    with pytest.raises(DataError, match=SAID.format(f"{size[0]} x {size[1]}")):
        sequence.frame(1)


def test_another_size_of_an_image_is_refused(tmp_path: Path) -> None:
    images = open_images(write_sequence(tmp_path, 2, width=9, height=7))
    write_frame(tmp_path / "synthetic.0001.exr", make_frame(1, width=5, height=4))
    with pytest.raises(DataError, match=SAID.format("5 x 4")):
        images.image(1)


@pytest.mark.parametrize("told", [{}, {"assignments": ["depth.scale=1"]}], ids=["own", "another tool's"])
def test_another_data_window_is_refused_where_frames_have_several(tmp_path: Path, told: dict[str, Any]) -> None:
    """The picture of such a sequence is the display window: the file's own is compared."""
    in_window(tmp_path, 0, 0, 5)
    in_window(tmp_path, 1, 2, 5)
    sequence = open_input(tmp_path, **told)
    assert sequence.frame(1).colour.shape == (7, 9, 3)
    in_window(tmp_path, 1, 3, 5)
    with pytest.raises(DataError, match=r"expected 5 x 7 at \(2, 0\) of 9 x 7, found 5 x 7 at \(3, 0\) of 9 x 7"):
        sequence.frame(1)
