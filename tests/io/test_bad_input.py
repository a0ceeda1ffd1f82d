"""Damaged, foreign and impossible files: one DataError or InputMissing each, nothing printed, no wrong picture."""

from __future__ import annotations

import os
import struct
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
    StorageError,
)
from cltaa.io.content import FileCopy, copied
from cltaa.io.exr_frame import Pixels, frame_attributes
from cltaa.io.exr_header import MIP_MAP, RIP_MAP, TILED, Outline
from cltaa.io.exr_read import read_colour, read_header, read_image
from cltaa.io.exr_write import write_frame, write_image
from tests.faults.exr_surgery import dissect
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


def test_chunk_table_of_zeros_is_an_unfinished_file(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_image(path, planes(), attributes())
    content = bytearray(path.read_bytes())
    chunks = -(-HEIGHT // 16)
    table = next(
        place
        for place in range(len(content))
        if int.from_bytes(content[place : place + 8], "little") == place + 8 * chunks
    )
    content[table : table + 8 * chunks] = bytes(8 * chunks)
    path.write_bytes(content)
    assert "never finished" in refusal(path, read_header)


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


def test_an_unreadable_file_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Permission bits do not stop root, so the refusal of the system is injected."""
    write_image(tmp_path / "a.exr", planes(), attributes())

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)
    assert "permission denied" in refusal(tmp_path / "a.exr", error=InputMissing)


def test_wrong_camera_is_not_written(tmp_path: Path) -> None:
    frame = make_frame()
    frame.camera.world_to_view[0, 0] = float("nan")
    with pytest.raises(DataError, match=r"frame 0: camera\.world_to_view holds NaN"):
        write_frame(tmp_path / "a.exr", frame)
    assert not list(tmp_path.iterdir())


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


def test_region_is_read_and_one_outside_of_the_display_window_is_refused(tmp_path: Path) -> None:
    display = {"displayWindow": window(0, 0, WIDTH - 1, HEIGHT - 1)}
    write_raw(tmp_path / "a.exr", display | {"dataWindow": window(1, -2, WIDTH, HEIGHT - 3)}, planes())
    assert read_frame(tmp_path / "a.exr").colour.shape == (HEIGHT, WIDTH, 3)
    write_raw(tmp_path / "a.exr", display | {"dataWindow": window(WIDTH, 0, 2 * WIDTH - 1, HEIGHT - 1)}, planes())
    assert "outside of the display window" in refusal(tmp_path / "a.exr")


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


@pytest.mark.parametrize("mode", [MIP_MAP, RIP_MAP])
def test_images_of_many_levels_are_refused_by_name(mode: int, tmp_path: Path) -> None:
    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize = 16, 8
    write_raw(tmp_path / "a.exr", {"type": OpenEXR.tiledimage, "tiles": tiles}, planes())
    file = dissect(tmp_path / "a.exr")
    file.version |= TILED
    file.set(b"tiles", struct.pack("<IIB", 16, 8, mode))
    (tmp_path / "a.exr").write_bytes(file.assembled())
    assert "mip-mapped images are not read" in refusal(tmp_path / "a.exr")


def test_deep_multi_part_and_sub_sampled_images_are_refused_by_name(tmp_path: Path) -> None:
    sound = tmp_path / "a.exr"
    write_raw(sound, {}, planes())
    content = sound.read_bytes()
    sound.write_bytes(content[:5] + b"\x08" + content[6:])
    assert "deep images are not read" in refusal(sound)
    channel = b"G\0" + (2).to_bytes(4, "little") + bytes(4)
    sampling = (1).to_bytes(4, "little")
    assert channel + sampling in content
    sound.write_bytes(content.replace(channel + sampling, channel + (2).to_bytes(4, "little")))
    message = refusal(sound)
    assert "channel G: sub-sampled" in message
    OpenEXR.File([OpenEXR.Part({}, planes(), name) for name in ("left", "right")]).write(str(sound))
    assert "multi-part images are not read" in refusal(sound)


@pytest.mark.parametrize("side", [16385, 2**31 - 1, -5])
def test_impossible_sizes_are_refused_before_memory_is_asked_for(tmp_path: Path, side: int) -> None:
    path = tmp_path / "a.exr"
    write_raw(path, {}, planes())
    content = path.read_bytes()
    sound = b"".join(number.to_bytes(4, "little") for number in (0, 0, WIDTH - 1, HEIGHT - 1))
    huge = b"".join(number.to_bytes(4, "little", signed=True) for number in (0, 0, side - 1, HEIGHT - 1))
    path.write_bytes(content.replace(sound, huge))
    assert "impossible data window" in refusal(path)


def test_output_into_a_missing_folder_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "missing" / "a.exr", tmp_path / "file" / "a.exr"):
        (tmp_path / "file").touch()
        with pytest.raises(OutputError, match="cannot be created"):
            write_frame(path, make_frame())


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_failure_while_writing_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    path = tmp_path / "a.exr"
    write_frame(path, make_frame())
    before = path.read_bytes()

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr({"fsync": os, "replace": Path}[step], step, fail)
    with pytest.raises(StorageError, match="No space left"):
        write_frame(path, make_frame(seed=1))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_leaves_no_file(tmp_path: Path) -> None:
    """/dev/full refuses every byte, as a full disk does."""
    link = tmp_path / f".a.exr.tmp.{os.getpid()}"
    link.symlink_to("/dev/full")
    with pytest.raises(StorageError, match=r"a\.exr"):
        write_frame(tmp_path / "a.exr", make_frame())
    assert not (tmp_path / "a.exr").exists()
    assert not link.is_symlink()


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
