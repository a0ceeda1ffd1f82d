"""Chunks that threads decode: each that fails counts, what was begun is ended, an interrupt leaves nothing behind."""

from __future__ import annotations

import gc
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from cltaa.exr import core as exr_core
from cltaa.io.exr_read import read_frame
from cltaa.io.exr_write import write_frame, write_image
from tests.io.decoding import HEIGHT, WIDTH, channels, decode
from tests.sequence_factory import make_frame

pytestmark = pytest.mark.usefixtures("three_threads")


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
