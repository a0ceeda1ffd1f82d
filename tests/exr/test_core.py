"""What is decoded straight into planes is what OpenEXR's module decodes; what cannot be is left to the module."""

from __future__ import annotations

import ctypes
import gc
import threading
import time
import tracemalloc
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

from cltaa.errors import DataError
from cltaa.exr import core as exr_core
from cltaa.exr.layout import LOSSLESS, PIXEL_BYTES
from cltaa.exr.outline import read_layout
from cltaa.exr.read import read_frame, read_image
from cltaa.exr.write import write_frame, write_image
from cltaa.files.content import Copy
from cltaa.frames import Frame
from cltaa.memory import allocator
from cltaa.memory.haloed import empty_haloed
from tests.sequence_factory import bits, make_frame, special_values

WIDTH, HEIGHT = 37, 301  # more rows than any chunk of scan lines has, and no multiple of them
Pixels = NDArray[Any]


@pytest.fixture(autouse=True, scope="module")
def _there() -> None:
    assert exr_core.core() is not None


@pytest.fixture(autouse=True)
def _threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many on every machine: with one core the caller would decode."""
    monkeypatch.setattr(OpenEXR, "global_thread_count", lambda: 3)


def channels(kind: str) -> dict[str, Pixels]:
    """More of them than the library has room for without asking; names in another order than the file's."""
    random = np.random.default_rng(1)
    made: dict[str, Pixels] = {"id": random.integers(0, 2**32, (HEIGHT, WIDTH), dtype=np.uint32)}
    for name in ("Z", "backward.v", "backward.u", "R", "G", "B", "a"):
        made[name] = random.standard_normal((HEIGHT, WIDTH)).astype("float32" if name == "Z" else kind)
    return made


def decode(path: Path, *, leave_out: str = "") -> dict[str, Pixels] | None:
    """Every channel decoded into planes whose rows lie apart, filled with sevens before."""
    layout = read_layout(path)
    planes: dict[str, Pixels] = {}
    for name, kind in layout.channels.items():
        plane = empty_haloed(1, layout.height, layout.width)[0]
        plane[...] = 7.0
        planes[name] = plane.view(np.uint32) if kind == "uint" else plane
    planes.pop(leave_out, None)
    copy = Copy()
    with path.open("rb") as file:
        copy.fill(path, file)
    return planes if exr_core.decode(copy, layout, planes) else None


@pytest.mark.parametrize("fill", [0x55, 0xAA])
def test_a_pipeline_is_as_long_as_the_library_s(tmp_path: Path, fill: int) -> None:
    """A longer one of the library's would be written over what lies behind ours."""
    write_frame(tmp_path / "a.exr", make_frame(0))
    core, ours = exr_core.core(), ctypes.sizeof(exr_core._Pipeline)
    assert core is not None
    context, chunk = ctypes.c_void_p(), exr_core._Chunk()
    assert core.long.exr_start_read(ctypes.byref(context), bytes(tmp_path / "a.exr"), None) == 0
    assert core.quick.exr_read_scanline_chunk_info(context, 0, 0, ctypes.byref(chunk)) == 0
    memory = (ctypes.c_uint8 * (2 * ours))(*[fill] * (2 * ours))
    exr_core._Pipeline.from_buffer(memory).pipe_size = ours
    both = (context, 0, ctypes.byref(chunk), ctypes.byref(memory))
    assert core.quick.exr_decoding_initialize(*both) == 0
    assert max(place for place, byte in enumerate(memory) if byte != fill) == ours - 1
    core.quick.exr_decoding_destroy(context, ctypes.byref(memory))
    core.long.exr_finish(ctypes.byref(context))


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


def test_what_is_not_wanted_is_left_out(tmp_path: Path) -> None:
    write_image(tmp_path / "a.exr", channels("float32"))
    decoded = decode(tmp_path / "a.exr", leave_out="G")
    assert decoded is not None
    assert decoded.keys() == channels("float32").keys() - {"G"}
    np.testing.assert_array_equal(decoded["R"], channels("float32")["R"])


def test_tiles_are_left_to_the_module(tmp_path: Path) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
    OpenEXR.File(header, channels("float32")).write(str(tmp_path / "a.exr"))
    assert decode(tmp_path / "a.exr") is None


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


@pytest.mark.parametrize("chunks", [1, 2])
def test_each_chunk_that_fails_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunks: int) -> None:
    """The last of one chunk, or one of many that are decoded side by side."""
    library, path = exr_core.core(), tmp_path / "a.exr"
    assert library is not None
    run: Any = library.long.exr_decoding_run
    write_image(path, {name: plane[: 16 * chunks - 3] for name, plane in channels("float32").items()})
    assert decode(path) is not None

    class Failing:
        def __getattr__(self, name: str) -> Any:
            return getattr(library.long, name)  # type: ignore[union-attr]

        def exr_decoding_run(self, context: Any, part: int, pipeline: Any) -> int:
            last = pipeline._obj.chunk.idx == chunks - 1
            return 1 if last else run(context, part, pipeline)

    failing: Any = Failing()
    monkeypatch.setattr(exr_core, "core", lambda: library._replace(long=failing))
    assert decode(path) is None


def test_an_interrupt_leaves_the_file_to_its_threads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C while they are waited for: none is left with a file that was closed."""
    write_image(tmp_path / "a.exr", channels("float32"))
    library, closed, at_work, held = exr_core.core(), list[int](), threading.Event(), threading.Event()
    assert library is not None
    start, finish, run = (getattr(library.long, f"exr_{name}") for name in ("start_read", "finish", "decoding_run"))
    chunks = list[int]()

    class Slow:
        exr_start_read = start

        def exr_decoding_run(self, *given: Any) -> Any:
            chunks.append(1)
            at_work.set()
            assert held.wait(60)
            assert not closed
            return run(*given)

        def exr_finish(self, context: Any) -> None:
            finish(context)
            closed.append(1)

    def interrupted(_: Any) -> None:
        assert at_work.wait(60)
        raise KeyboardInterrupt

    slow: Any = Slow()
    monkeypatch.setattr(exr_core, "core", lambda: library._replace(long=slow))
    monkeypatch.setattr(exr_core, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        decode(tmp_path / "a.exr")
    assert not closed
    held.set()
    deadline = time.monotonic() + 60
    while not closed and time.monotonic() < deadline:
        gc.collect()
        time.sleep(0.01)
    assert closed
    assert len(chunks) <= OpenEXR.global_thread_count()  # of 19: those that were begun
    monkeypatch.undo()
    assert decode(tmp_path / "a.exr") is not None  # by the same threads


@pytest.mark.parametrize("kept", [HEIGHT, 16])
def test_what_was_begun_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: int) -> None:
    """Pipelines hold memory of the library's; by several threads, and for one chunk by the caller."""
    write_image(tmp_path / "a.exr", {name: plane[:kept] for name, plane in channels("float32").items()})
    library, called = exr_core.core(), Counter[str]()
    assert library is not None

    class Counting:
        def __getattr__(self, name: str) -> Any:
            called[name] += 1
            return getattr(library.quick, name)  # type: ignore[union-attr]

    counting: Any = Counting()
    monkeypatch.setattr(exr_core, "core", lambda: library._replace(quick=counting))
    assert decode(tmp_path / "a.exr") is not None
    assert called["exr_decoding_destroy"] == called["exr_decoding_initialize"] > 0


def test_where_no_thread_is_given_work_the_module_decodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As at the end of the program; one chunk needs none."""
    path = tmp_path / "a.0003.exr"
    write_frame(path, make_frame(3, width=WIDTH, height=HEIGHT))
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    monkeypatch.setattr(exr_core, "_threads", lambda _: pool)
    assert decode(path) is None
    np.testing.assert_array_equal(read_frame(path).depth, make_frame(3, width=WIDTH, height=HEIGHT).depth)
    write_image(path, {"Z": channels("float32")["Z"][:16]})
    assert decode(path) is not None


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


@pytest.mark.parametrize(
    ("name", "value"), [("start_y", 1), ("width", WIDTH + 1), ("height", 0), ("height", HEIGHT + 1)]
)
def test_a_library_that_means_other_chunks_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, value: int
) -> None:
    """As one would whose structures are laid out in another way: more rows than are left would go behind a plane."""
    write_image(tmp_path / "a.exr", channels("float32"))
    library = exr_core.core()
    assert library is not None

    class Other:
        def __getattr__(self, called: str) -> Any:
            return getattr(library.quick, called)  # type: ignore[union-attr]

        def exr_read_scanline_chunk_info(self, context: Any, part: int, y: int, chunk: Any) -> int:
            failed: int = library.quick.exr_read_scanline_chunk_info(context, part, y, chunk)  # type: ignore[union-attr]
            setattr(chunk._obj, name, value)
            return failed

    other: Any = Other()
    monkeypatch.setattr(exr_core, "core", lambda: library._replace(quick=other))
    assert decode(tmp_path / "a.exr") is None


def test_a_library_that_means_other_channels_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As one would whose structures are laid out in another way."""
    write_image(tmp_path / "a.exr", channels("float32"))
    monkeypatch.setitem(PIXEL_BYTES, "float", 2)
    assert decode(tmp_path / "a.exr") is None
