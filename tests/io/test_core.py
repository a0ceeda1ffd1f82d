"""What is decoded straight into planes is what OpenEXR's module decodes; what cannot be is left to the module."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from cltaa.core import planes as allocator
from cltaa.errors import DataError
from cltaa.exr import core as exr_core
from cltaa.frame import Frame
from cltaa.io.content import Copy
from cltaa.io.exr_header import read_layout
from cltaa.io.exr_layout import LOSSLESS
from cltaa.io.exr_read import read_frame, read_image
from cltaa.io.exr_write import write_frame, write_image
from tests.io.decoding import HEIGHT, WIDTH, Pixels, channels, decode
from tests.sequence_factory import bits, make_frame, special_values

pytestmark = pytest.mark.usefixtures("three_threads")


def assert_as_the_module(path: Path) -> None:
    decoded, (expected, _) = decode(path), read_image(path)
    assert decoded is not None
    assert decoded.keys() == expected.keys()
    for name, plane in expected.items():
        wide = plane if plane.dtype == np.uint32 else plane.astype(np.float32)
        np.testing.assert_array_equal(bits(decoded[name]), bits(wide), err_msg=name)


@pytest.mark.parametrize("kind", ["float32", "float16"])
@pytest.mark.parametrize("compression", sorted(LOSSLESS))
def test_every_compression(tmp_path: Path, compression: str, kind: str) -> None:
    write_image(tmp_path / "a.exr", channels(kind), compression=compression)
    assert_as_the_module(tmp_path / "a.exr")


@pytest.mark.parametrize("first", [(0, 0), (-5, -120), (3, 40)])
def test_windows_of_any_place(tmp_path: Path, first: tuple[int, int]) -> None:
    x, y = first
    window = (x, y, x + WIDTH - 1, y + HEIGHT - 1)
    write_image(tmp_path / "a.exr", channels("float32"), windows=(window, (0, 0, 99, 199)))
    assert_as_the_module(tmp_path / "a.exr")


def test_special_values_of_floats_and_halves(tmp_path: Path) -> None:
    every_half = np.arange(2**16, dtype=np.uint16).reshape(256, 256).view(np.float16)
    write_image(tmp_path / "half.exr", {"R": every_half})
    assert_as_the_module(tmp_path / "half.exr")
    write_image(tmp_path / "float.exr", {"R": special_values()})
    assert_as_the_module(tmp_path / "float.exr")


def test_lines_from_the_bottom_up(tmp_path: Path) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "lineOrder": OpenEXR.DECREASING_Y}
    OpenEXR.File(header, channels("float32")).write(str(tmp_path / "a.exr"))
    assert_as_the_module(tmp_path / "a.exr")


@pytest.mark.parametrize("compression", ["zip", "piz"])
def test_halves_stay_halves_where_they_are_to(tmp_path: Path, compression: str) -> None:
    write_image(tmp_path / "a.exr", channels("float16"), compression=compression)
    decoded, (expected, _) = decode(tmp_path / "a.exr", widen=False), read_image(tmp_path / "a.exr")
    assert decoded is not None
    for name, plane in expected.items():
        assert decoded[name].dtype == plane.dtype
        np.testing.assert_array_equal(bits(decoded[name]), bits(plane), err_msg=name)


def test_what_is_not_wanted_is_left_out(tmp_path: Path) -> None:
    write_image(tmp_path / "a.exr", channels("float32"))
    decoded = decode(tmp_path / "a.exr", leave_out="G")
    assert decoded is not None
    assert decoded.keys() == channels("float32").keys() - {"G"}
    np.testing.assert_array_equal(decoded["R"], channels("float32")["R"])


@pytest.mark.parametrize("compression", [OpenEXR.ZIP_COMPRESSION, OpenEXR.PIZ_COMPRESSION, OpenEXR.DWAA_COMPRESSION])
@pytest.mark.parametrize("tile", [(16, 16), (5, 64), (37, 301), (512, 40)])
@pytest.mark.parametrize("first", [(0, 0), (-5, -120)])
def test_tiles(tmp_path: Path, first: tuple[int, int], tile: tuple[int, int], compression: OpenEXR.Compression) -> None:
    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize = tile
    window = np.array(first, np.int32), np.array((first[0] + WIDTH - 1, first[1] + HEIGHT - 1), np.int32)
    header = {"compression": compression, "type": OpenEXR.tiledimage, "tiles": tiles, "dataWindow": window}
    OpenEXR.File(header, channels("float16")).write(str(tmp_path / "a.exr"))
    assert_as_the_module(tmp_path / "a.exr")


@pytest.mark.parametrize("compression", ["zip", "zips", "piz", "rle", "zstd"])
def test_damage_is_the_module_s_to_tell(tmp_path: Path, compression: str, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.0000.exr"
    frame = make_frame(0, width=WIDTH, height=HEIGHT)
    packs = replace(frame, colour=np.round(frame.colour), depth=np.round(frame.depth))
    write_frame(path, packs, compression=compression)
    content = bytearray(path.read_bytes())
    content[-64:] = b"\xff" * 64  # the end of the last chunk
    path.write_bytes(content)
    told = False
    try:
        read_image(path)
    except DataError:
        told = True
    assert told or compression in ("piz", "rle")  # which take them for pixels
    assert (decode(path) is None) == told
    if told:
        with pytest.raises(DataError, match="damaged"):
            read_frame(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("plane", [np.zeros((WIDTH, HEIGHT), "f4").T, np.zeros((HEIGHT - 1, WIDTH), "f4")])
def test_planes_that_do_not_fit_are_refused(tmp_path: Path, plane: Pixels) -> None:
    """Numbers that lie apart in a row, and a row too few: what is decoded would be written beside them."""
    path = tmp_path / "a.exr"
    write_image(path, channels("float32"))
    copy = Copy()
    with path.open("rb") as file:
        copy.fill(path, file)
    with pytest.raises(ValueError, match="numbers side by side, as many as the picture"):
        exr_core.decode(copy, read_layout(path), {"Z": plane})


def test_a_frame_takes_no_memory_but_that_of_earlier_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, plane = tmp_path / "a.0003.exr", 4 * WIDTH * HEIGHT
    write_frame(path, make_frame(3, width=WIDTH, height=HEIGHT, motion=True, alpha=True, reactive=True))
    monkeypatch.setattr(allocator, "SMALLEST", 0)
    with allocator.kept_memory(plane):
        lay = where(read_frame(path))
        tracemalloc.start()  # which sees what Python and NumPy allocate, and no mapping
        lies = where(read_frame(path))
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert lies == lay
    assert peak < plane


def where(frame: Frame) -> set[int]:
    """The blocks that its channels lie in."""
    there = (frame.colour, frame.depth, frame.motion, frame.alpha, frame.reactive)
    return {plane.ctypes.data // allocator.LARGE_PAGE for plane in there if plane is not None}
