"""The library that decodes straight into planes: used where it means what is expected, and nowhere else."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from cltaa.exr import core as exr_core
from cltaa.exr import core_structures
from cltaa.io.exr_layout import PIXEL_BYTES
from cltaa.io.exr_read import read_frame
from cltaa.io.exr_write import write_frame, write_image
from tests.io.decoding import HEIGHT, WIDTH, channels, decode
from tests.sequence_factory import bits, make_frame

pytestmark = pytest.mark.usefixtures("three_threads")


@pytest.mark.parametrize("fill", [0x55, 0xAA])
def test_a_pipeline_is_as_long_as_the_library_s(tmp_path: Path, fill: int) -> None:
    """A longer one of the library's would be written over what lies behind ours."""
    write_frame(tmp_path / "a.exr", make_frame(0))
    core, ours = exr_core.core(), ctypes.sizeof(core_structures.Pipeline)
    assert core is not None
    context, chunk = ctypes.c_void_p(), core_structures.Chunk()
    assert core.long.exr_start_read(ctypes.byref(context), bytes(tmp_path / "a.exr"), None) == 0
    assert core.quick.exr_read_scanline_chunk_info(context, 0, 0, ctypes.byref(chunk)) == 0
    memory = (ctypes.c_uint8 * (2 * ours))(*[fill] * (2 * ours))
    core_structures.Pipeline.from_buffer(memory).pipe_size = ours
    both = (context, 0, ctypes.byref(chunk), ctypes.byref(memory))
    assert core.quick.exr_decoding_initialize(*both) == 0
    assert max(place for place, byte in enumerate(memory) if byte != fill) == ours - 1
    core.quick.exr_decoding_destroy(context, ctypes.byref(memory))
    core.long.exr_finish(ctypes.byref(context))


def frame_by(core: Callable[[], Any], path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    with monkeypatch.context() as patch:
        patch.setattr(exr_core, "core", core)
        return read_frame(path)


def test_without_the_library_frames_are_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.0003.exr"
    write_frame(path, make_frame(3, motion=True, alpha=True, reactive=True, object_id=True, normal=True))
    here, without = frame_by(exr_core.core, path, monkeypatch), frame_by(lambda: None, path, monkeypatch)
    for name in ("colour", "depth", "motion", "alpha", "reactive", "object_id", "normal"):
        np.testing.assert_array_equal(bits(getattr(here, name)), bits(getattr(without, name)), err_msg=name)
        assert getattr(here, name).strides == getattr(without, name).strides


def test_a_library_of_another_version_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    for other in ((3, 4), (3, 6), (4, 5)):
        monkeypatch.setattr(exr_core, "VERSION", other)
        assert exr_core.core.__wrapped__() is None
    monkeypatch.setattr(OpenEXR, "__file__", "/nowhere.so")
    assert exr_core.core.__wrapped__() is None


def spoil(monkeypatch: pytest.MonkeyPatch, function: str, afterwards: Callable[..., None]) -> None:
    """Have the library do something more at the end of one of its functions, with the same arguments."""
    library = exr_core.core()
    assert library is not None
    quick = library.quick

    class Other:
        def __getattr__(self, called: str) -> Any:
            return spoilt if called == function else getattr(quick, called)

    def spoilt(*arguments: Any) -> int:
        failed: int = getattr(quick, function)(*arguments)
        afterwards(*arguments)
        return failed

    other: Any = Other()
    monkeypatch.setattr(exr_core, "core", lambda: library._replace(quick=other))


@pytest.mark.parametrize(
    ("name", "value"), [("start_y", 1), ("width", WIDTH + 1), ("height", 0), ("height", HEIGHT + 1)]
)
def test_a_library_that_means_other_chunks_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, value: int
) -> None:
    """As one would whose structures are laid out in another way: more rows than are left would go behind a plane."""
    write_image(tmp_path / "a.exr", channels("float32"))

    def other_rows(_context: Any, _part: int, _y: int, chunk: Any) -> None:
        setattr(chunk._obj, name, value)

    spoil(monkeypatch, "exr_read_scanline_chunk_info", other_rows)
    assert decode(tmp_path / "a.exr") is None


@pytest.mark.parametrize(("name", "value"), [("start_x", 1), ("start_y", 1), ("width", 17), ("height", 17)])
def test_a_library_that_means_other_tiles_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, value: int
) -> None:
    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize = 16, 16
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.tiledimage, "tiles": tiles}
    OpenEXR.File(header, channels("float32")).write(str(tmp_path / "a.exr"))

    def another(_context: Any, _part: int, _x: int, _y: int, _across: int, _down: int, chunk: Any) -> None:
        setattr(chunk._obj, name, value)

    spoil(monkeypatch, "exr_read_tile_chunk_info", another)
    assert decode(tmp_path / "a.exr") is None


def test_a_library_that_means_other_channels_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As one would whose structures are laid out in another way."""
    write_image(tmp_path / "a.exr", channels("float32"))
    monkeypatch.setitem(PIXEL_BYTES, "float", 2)
    assert decode(tmp_path / "a.exr") is None


def test_a_library_that_forgets_where_rows_go_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is set for the first chunk of a pipeline is to stand for the others."""
    write_image(tmp_path / "a.exr", channels("float32"))

    def forgets(_context: Any, _part: int, _chunk: Any, pipeline: Any) -> None:
        pipeline._obj.channels[0].user_line_stride = 0

    spoil(monkeypatch, "exr_decoding_update", forgets)
    monkeypatch.setattr(OpenEXR, "global_thread_count", lambda: 1)
    assert decode(tmp_path / "a.exr") is None
