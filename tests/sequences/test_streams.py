"""Reading ahead and writing behind: order, bounded memory, failures at the right place, threads that end."""

from __future__ import annotations

import gc
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from cltaa.errors import DataError, OutputError
from cltaa.exr.read import read_image
from cltaa.sequences.sources import open_sequence
from cltaa.sequences.streams import AHEAD, ReadAhead, Writer, read_ahead
from tests.sequence_factory import write_sequence

PATIENCE = 300.0  # seconds after which a thread that should have ended counts as hung, on a machine however busy


def cltaa_threads() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("cltaa")]


def wait_for(condition: object) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < deadline
        time.sleep(0.001)


class Counted:
    """Numbers up to ``count`` that remembers how many were asked for; fails before ``failing``."""

    def __init__(self, count: int, failing: int | None = None) -> None:
        self.count, self.failing, self.made = count, failing, 0

    def __iter__(self) -> Iterator[int]:
        """Yield the numbers."""
        for number in range(self.count):
            if number == self.failing:
                raise DataError("damaged", frame=number)
            self.made += 1
            yield number


def test_frames_come_in_order_with_their_times(tmp_path: Path) -> None:
    sequence = open_sequence(write_sequence(tmp_path, 5))
    with read_ahead(sequence) as frames:
        for number, frame in enumerate(frames):
            assert frame.index == number
            np.testing.assert_array_equal(frame.colour, sequence.frame(number).colour)
    assert len(frames.seconds) == 5
    assert min(frames.seconds) > 0
    assert cltaa_threads() == []
    assert list(frames) == []


@pytest.mark.parametrize("depth", [1, 2, 5])
def test_no_more_than_depth_ahead(depth: int) -> None:
    source = Counted(50)
    with read_ahead(source, depth) as numbers:
        for taken in range(50):
            wait_for(lambda: source.made == min(50, taken + depth))  # noqa: B023 (used up within the turn)
            time.sleep(0.001)
            assert source.made <= taken + depth
            assert next(numbers) == taken


def test_several_threads_keep_order_and_depth() -> None:
    """Three at a time, the later ones done first."""
    begun, gates = [], [threading.Event() for _ in range(20)]

    def made(number: int) -> int:
        begun.append(number)
        assert gates[number].wait(PATIENCE)
        return number

    with ReadAhead((partial(made, number) for number in range(20)), 4, 3) as numbers:
        wait_for(lambda: len(begun) == 3)
        for number in (2, 1):
            gates[number].set()
        wait_for(lambda: len(begun) == 4)  # as many as there are places, though two threads have nothing to do
        time.sleep(0.02)
        assert sorted(begun) == [0, 1, 2, 3]
        for gate in gates:
            gate.set()
        assert list(numbers) == list(range(20))
    assert len(numbers.seconds) == 20
    assert cltaa_threads() == []


def test_failure_comes_where_the_frame_was_due() -> None:
    with read_ahead(Counted(9, failing=3), 4) as numbers:
        assert [next(numbers) for _ in range(3)] == [0, 1, 2]
        with pytest.raises(DataError, match="frame 3: damaged"):
            next(numbers)
        assert list(numbers) == []
    assert cltaa_threads() == []


def test_leaving_early_ends_the_thread() -> None:
    source = Counted(1000)
    with read_ahead(source) as numbers:
        next(numbers)
    assert cltaa_threads() == []
    assert source.made <= 1 + AHEAD


def test_what_waits_for_a_thread_is_not_begun_after_the_close() -> None:
    begun, gate = [], threading.Event()

    def made(number: int) -> int:
        begun.append(number)
        assert gate.wait(PATIENCE)
        return number

    numbers = ReadAhead((partial(made, number) for number in range(9)), 4, 1)
    wait_for(lambda: begun)
    closing = threading.Thread(target=numbers.close)
    closing.start()
    wait_for(lambda: numbers._pool._shutdown)
    gate.set()
    closing.join(PATIENCE)
    assert begun == [0]
    assert list(numbers) == []


def test_nothing_comes_after_a_failure() -> None:
    """Though what was begun beside it can be made."""

    def made(number: int) -> int:
        if number == 1:
            raise DataError("damaged", frame=number)
        return number

    with ReadAhead((partial(made, number) for number in range(9)), 4, 2) as numbers:
        assert next(numbers) == 0
        with pytest.raises(DataError, match="frame 1: damaged"):
            next(numbers)
        assert cltaa_threads() == []
        assert list(numbers) == []


def test_forgotten_reader_and_writer_end_their_threads(tmp_path: Path) -> None:
    numbers, writer, gate = read_ahead(Counted(1000)), Writer(), threading.Event()

    def held() -> dict[str, np.ndarray]:
        assert gate.wait(PATIENCE)
        return image(0)

    next(numbers)
    for number in range(2):
        writer.write(tmp_path / f"{number}.exr", held)
    assert len(cltaa_threads()) == 3  # the second image needs a thread of its own while the first is not done
    gate.set()
    del numbers, writer
    gc.collect()
    assert cltaa_threads() == []


def test_threads_end_with_the_last_item() -> None:
    numbers = ReadAhead([partial(int, number) for number in range(9)])
    assert list(numbers) == list(range(9))
    assert cltaa_threads() == []


def test_depth_of_nothing() -> None:
    with pytest.raises(ValueError, match="depth"):
        read_ahead([], 0)
    with pytest.raises(ValueError, match="depth"):
        Writer(0)


def image(value: float, size: int = 8) -> dict[str, np.ndarray]:
    return {name: np.full((size, size), value, np.float32) for name in "RGB"}


def test_written_images_are_complete_at_the_close(tmp_path: Path) -> None:
    with Writer() as writer:
        for number in range(6):
            writer.write(tmp_path / f"{number}.exr", image(number), {"cltaa:frame": number})
    for number in range(6):
        channels, attributes = read_image(tmp_path / f"{number}.exr")
        np.testing.assert_array_equal(channels["G"], image(number)["G"])
        assert attributes["cltaa:frame"] == number
    assert len(writer.seconds) == 6
    assert cltaa_threads() == []
    with pytest.raises(ValueError, match="closed"):
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


def test_planes_that_cannot_be_made_are_a_failure_of_the_writer(tmp_path: Path) -> None:
    def impossible() -> dict[str, np.ndarray]:
        raise MemoryError

    writer = Writer()
    writer.write(tmp_path / "0.exr", impossible)
    with pytest.raises(MemoryError):
        writer.close()
    assert list(tmp_path.iterdir()) == []


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
    assert cltaa_threads() == []


@pytest.mark.parametrize("told_by", ["write", "flush", "close"])
def test_a_failure_beside_another_image_is_told_once(tmp_path: Path, told_by: str) -> None:
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
    assert cltaa_threads() == []


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
    assert cltaa_threads() == []


def test_exception_in_the_block_stands_beside_an_image_that_failed(tmp_path: Path) -> None:
    def interrupted() -> None:
        with Writer() as writer:
            writer.write(tmp_path / "missing" / "0.exr", image(0))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert cltaa_threads() == []


def test_exception_in_the_block_stands_and_and_queued_images_are_written(tmp_path: Path) -> None:
    def interrupted() -> None:
        with Writer() as writer:
            writer.write(tmp_path / "0.exr", image(0))
            writer.write(tmp_path / "1.exr", image(1))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.exr", "1.exr"]


def test_writer_waits_while_depth_images_are_unfinished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gate, begun = threading.Event(), []

    def slow(path: Path, *_: object, **__: object) -> None:
        begun.append(path)
        gate.wait(PATIENCE)

    monkeypatch.setattr("cltaa.sequences.streams.write_image", slow)
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


SCRIPT = """
import sys, time
from pathlib import Path
import numpy as np
from cltaa.sequences.sources import open_sequence
from cltaa.sequences.streams import Writer, read_ahead
frames, writer = read_ahead(open_sequence(sys.argv[1])), Writer()
for frame in frames:
    writer.write(Path(sys.argv[2]) / f"{frame.index}.exr", {"Z": frame.depth})
    print("written", flush=True)
    if len(sys.argv) > 3:
        while True:  # in short naps: a signal that comes just before a sleep is only seen after it
            time.sleep(0.1)
    break
"""


@pytest.mark.parametrize("interrupted", [False, True])
def test_program_that_ends_or_is_interrupted_does_not_hang(tmp_path: Path, interrupted: bool) -> None:
    """Threads are neither waited for in vain nor killed inside OpenEXR, and the queued image is complete."""
    folder = write_sequence(tmp_path / "in", 4)
    arguments = [sys.executable, "-c", SCRIPT, str(folder), str(tmp_path)] + ["wait"] * interrupted
    root = Path(__file__).parents[2]
    with subprocess.Popen(arguments, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "written\n"
        if interrupted:
            process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE)
    assert ("KeyboardInterrupt" in errors) == interrupted
    assert process.returncode in ((1, -signal.SIGINT) if interrupted else (0,))  # an abort would be -6
    assert read_image(tmp_path / "0.exr")[0]["Z"].shape == (23, 37)
