"""Writing behind: whole images, bounded memory, each failure told once, threads that end."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cltaa.errors import OutputError
from cltaa.io.exr_read import read_image
from cltaa.io.streams import Writer
from tests.io.stream_threads import PATIENCE, image, stream_threads, wait_for


def test_written_images_are_complete_at_the_close(tmp_path: Path) -> None:
    with Writer() as writer:
        for number in range(6):
            writer.write(tmp_path / f"{number}.exr", image(number), {"cltaa:frame": number})
    for number in range(6):
        channels, attributes = read_image(tmp_path / f"{number}.exr")
        np.testing.assert_array_equal(channels["G"], image(number)["G"])
        assert attributes["cltaa:frame"] == number
    assert len(writer.seconds) == 6
    assert stream_threads() == []
    with pytest.raises(ValueError, match="the writer is closed"):
        writer.write(tmp_path / "late.exr", image(0))


def test_planes_may_be_made_where_they_are_written(tmp_path: Path) -> None:
    makers: list[str] = []

    def made() -> dict[str, np.ndarray]:
        makers.append(threading.current_thread().name)
        return image(0.5)

    with Writer() as writer:
        writer.write(tmp_path / "0.exr", made)
    np.testing.assert_array_equal(read_image(tmp_path / "0.exr")[0]["G"], image(0.5)["G"])
    assert makers
    assert makers[0].startswith("cltaa write behind")


def test_first_failure_is_raised_and_what_was_finished_stays(tmp_path: Path) -> None:
    writer = Writer(threads=1)
    writer.write(tmp_path / "0.exr", image(0))
    writer.write(tmp_path / "missing" / "1.exr", image(1))

    def write_more() -> None:
        for number in range(2, 20):
            writer.write(tmp_path / f"{number}.exr", image(number))

    with pytest.raises(OutputError, match=r"1\.exr"):
        write_more()
    assert [path.name for path in tmp_path.iterdir()] == ["0.exr"]
    writer.close()  # the failure was told once
    assert stream_threads() == []


@pytest.mark.parametrize("told_by", ["write", "flush", "close"])
def test_a_failure_beside_another_image_is_reported_once(tmp_path: Path, told_by: str) -> None:
    writer = Writer()
    writer.write(tmp_path / "missing" / "0.exr", image(0))
    wait_for(writer._failed.is_set)
    calls: dict[str, Callable[[], None]] = {
        "write": lambda: writer.write(tmp_path / "1.exr", image(1)),
        "flush": writer.flush,
        "close": writer.close,
    }
    with pytest.raises(OutputError, match=r"0\.exr"):
        calls[told_by]()
    writer.close()
    assert list(tmp_path.iterdir()) == []
    assert stream_threads() == []


def test_two_images_that_fail_side_by_side_are_one_failure(tmp_path: Path) -> None:
    together = threading.Barrier(2)

    def impossible() -> dict[str, np.ndarray]:
        together.wait(PATIENCE)
        raise MemoryError

    writer = Writer(2, threads=2)
    for number in range(2):
        writer.write(tmp_path / f"{number}.exr", impossible)
    with pytest.raises(MemoryError):
        writer.flush()
    writer.close()
    assert list(tmp_path.iterdir()) == []
    assert stream_threads() == []


def test_exception_in_the_block_stands_and_queued_images_are_written(tmp_path: Path) -> None:
    def interrupted(*names: str) -> None:
        with Writer() as writer:
            for name in names:
                writer.write(tmp_path / name, image(0))
            raise KeyboardInterrupt

    for names in (["0.exr", "1.exr"], ["missing/0.exr"]):  # even beside an image that failed
        with pytest.raises(KeyboardInterrupt):
            interrupted(*names)
        assert stream_threads() == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.exr", "1.exr"]


def test_writer_waits_while_depth_images_are_unfinished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gate, begun = threading.Event(), []

    def slow(path: Path, *_: object, **__: object) -> None:
        begun.append(path)
        gate.wait(PATIENCE)

    monkeypatch.setattr("cltaa.io.streams.write_image", slow)
    handed_over: list[int] = []

    def hand_over() -> None:
        with Writer(2, threads=1) as writer:
            for number in range(5):
                writer.write(tmp_path / f"{number}.exr", image(number))
                handed_over.append(number)

    caller = threading.Thread(target=hand_over)
    caller.start()
    wait_for(lambda: len(handed_over) == 2 and len(begun) == 1)
    time.sleep(0.02)
    assert handed_over == [0, 1]
    gate.set()
    caller.join(PATIENCE)
    assert handed_over == [0, 1, 2, 3, 4]
