"""Reading ahead: order, bounded memory, failures at the right place, threads that end."""

from __future__ import annotations

import threading
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from cltaa.errors import DataError
from cltaa.io.sequence import open_sequence
from cltaa.io.streams import AHEAD, ReadAhead, read_ahead
from tests.io.stream_threads import PATIENCE, Counted, stream_threads, wait_for
from tests.sequence_factory import write_sequence


def test_frames_come_in_order_with_their_times(tmp_path: Path) -> None:
    sequence = open_sequence(write_sequence(tmp_path, 5))
    with read_ahead(sequence) as frames:
        for number, frame in enumerate(frames):
            assert frame.index == number
            np.testing.assert_array_equal(frame.colour, sequence.frame(number).colour)
    assert len(frames.seconds) == 5
    assert min(frames.seconds) > 0
    assert stream_threads() == []
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


def test_with_depth_0_items_are_made_on_demand() -> None:
    source = Counted(5)
    with read_ahead(source, 0) as numbers:
        for taken in range(5):
            assert source.made == taken
            assert next(numbers) == taken
        assert list(numbers) == []
    assert list(numbers) == []


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
    assert stream_threads() == []


def test_failure_comes_where_the_frame_was_due() -> None:
    with read_ahead(Counted(9, failing=3), 4) as numbers:
        assert [next(numbers) for _ in range(3)] == [0, 1, 2]
        with pytest.raises(DataError, match="frame 3: damaged"):
            next(numbers)
        assert list(numbers) == []
    assert stream_threads() == []


def test_leaving_early_ends_the_thread() -> None:
    source = Counted(1000)
    with read_ahead(source) as numbers:
        next(numbers)
    assert stream_threads() == []
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
        assert stream_threads() == []
        assert list(numbers) == []
