"""Damaged, foreign and impossible files: one DataError or InputMissing each, nothing printed, no wrong picture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import OpenEXR
import pytest

from cltaa.errors import (
    CltaaError,
    DataError,
    InputMissing,
    OutputError,
    ResourceError,
)
from cltaa.io.content import FileCopy, copied
from cltaa.io.exr_frame import Pixels, frame_attributes
from cltaa.io.exr_header import Outline
from cltaa.io.exr_read import read_colour, read_header, read_image
from cltaa.io.exr_write import write_frame, write_image
from tests.sequence_factory import HEIGHT, WIDTH, make_frame, read_frame


def planes(**changes: Pixels | None) -> dict[str, Pixels]:
    """Channels of a sound frame; a change to None leaves the channel out."""
    sound: dict[str, Pixels | None] = {name: np.ones((HEIGHT, WIDTH), np.float32) for name in "RGBZ"}
    return {name: plane for name, plane in (sound | changes).items() if plane is not None}


def attributes(**changes: object) -> dict[str, object]:
    """Attributes of a sound frame, with those given by the part of the name behind ``cltaa:`` changed or left out."""
    sound = frame_attributes(make_frame()) | {f"cltaa:{name}": value for name, value in changes.items()}
    return {name: value for name, value in sound.items() if value is not None}


def refusal(path: Path, read: Callable[[Path], Any] = read_frame, error: type[CltaaError] = DataError) -> str:
    with pytest.raises(error) as caught:
        read(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"", "empty"), (b"not an image, but long enough to be one", "not an EXR"), (b"v/1\x01", "not an EXR")],
)
def test_garbage_is_refused_by_every_reader(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.exr"
    path.write_bytes(content)
    for read in (read_frame, read_header, read_image, read_colour):
        assert message in refusal(path, read)


def test_missing_folder_and_dangling_link(tmp_path: Path) -> None:
    assert "missing" in refusal(tmp_path / "a.exr", error=InputMissing)
    (tmp_path / "link.exr").symlink_to(tmp_path / "nothing.exr")
    assert "missing" in refusal(tmp_path / "link.exr", error=InputMissing)
    (tmp_path / "folder.exr").mkdir()
    assert "folder" in refusal(tmp_path / "folder.exr")


def window(left: int, top: int, right: int, bottom: int) -> tuple[np.ndarray, np.ndarray]:
    return np.array([left, top], np.int32), np.array([right, bottom], np.int32)


def write_raw(path: Path, header: dict[str, Any], channels: dict[str, Any]) -> None:
    """Write what our own writer refuses to."""
    OpenEXR.File(attributes() | header, channels).write(str(path))


def test_overscan_is_kept(tmp_path: Path) -> None:
    columns = np.arange(WIDTH, dtype=np.float32)[None, :] + 100 * np.arange(HEIGHT, dtype=np.float32)[:, None]
    windows = {
        "dataWindow": window(-2, -3, WIDTH - 3, HEIGHT - 4),
        "displayWindow": window(0, 0, WIDTH - 6, HEIGHT - 6),
    }
    write_raw(tmp_path / "a.exr", windows, dict.fromkeys("RGBZ", columns))
    frame = read_frame(tmp_path / "a.exr")
    np.testing.assert_array_equal(frame.colour[..., 1], columns)


def test_tiles_are_read_right(tmp_path: Path) -> None:
    pixels = np.random.default_rng(7).random((HEIGHT, WIDTH), dtype=np.float32)
    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize = 16, 8
    header = {"type": OpenEXR.tiledimage, "tiles": tiles}
    write_raw(tmp_path / "a.exr", header, dict.fromkeys("RGBZ", pixels))
    np.testing.assert_array_equal(read_frame(tmp_path / "a.exr").depth, pixels)
    content = (tmp_path / "a.exr").read_bytes()
    (tmp_path / "a.exr").write_bytes(content[:-1])
    assert "truncated" in refusal(tmp_path / "a.exr")


def test_output_into_a_missing_folder_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "missing" / "a.exr", tmp_path / "file" / "a.exr"):
        (tmp_path / "file").touch()
        with pytest.raises(OutputError, match="cannot be created"):
            write_frame(path, make_frame())


@pytest.mark.parametrize("another", [{"R": (HEIGHT, WIDTH)}, dict.fromkeys("RGBZ", (HEIGHT, WIDTH - 1))])
def test_a_file_that_changes_between_its_header_and_its_pixels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, another: dict[str, tuple[int, int]]
) -> None:
    """Other channels, and another size: OpenEXR decodes them, and they would not fit where they go."""
    write_raw(tmp_path / "a.exr", attributes(), planes())
    write_raw(tmp_path / "b.exr", attributes(), {name: np.ones(size, np.float32) for name, size in another.items()})

    def copy_other(path: Path, _: BinaryIO) -> FileCopy:
        with (tmp_path / "b.exr").open("rb") as file:
            return copied(path, file)

    monkeypatch.setattr("cltaa.io.exr_read.copied", copy_other)
    monkeypatch.setattr(Outline, "check_chunks", lambda *_: None)
    for read in (read_frame, read_image, read_colour):
        with pytest.raises(DataError, match=r"a\.exr: the file changed while it was read"):
            read(tmp_path / "a.exr")


@pytest.mark.parametrize("compression", ["none", "zip"])
def test_pixels_fit_into_memory_beside_the_file_or_one_channel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: str
) -> None:
    """Whichever is larger: a packed file of one colour is the smaller one."""
    path, pixels = tmp_path / "a.exr", 4 * HEIGHT * WIDTH
    write_image(path, planes(), attributes(), compression=compression)
    larger = max(path.stat().st_size, pixels)
    assert (larger == pixels) == (compression == "zip")
    monkeypatch.setattr("cltaa.io.content.memory_limit", lambda: 4 * pixels + larger)
    read_image(path)
    monkeypatch.setattr("cltaa.io.content.memory_limit", lambda: 4 * pixels + larger - 1)
    with pytest.raises(ResourceError, match="does not fit into memory"):
        read_image(path)
