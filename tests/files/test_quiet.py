"""What OpenEXR prints while it decodes is swallowed; what anything else prints is not."""

from __future__ import annotations

import io
import sys
import threading

import pytest

from cltaa.progress import track
from cltaa.quiet import muted_output


def test_only_this_thread_is_muted(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stdout", stream)
    with muted_output():
        print("noise")
        other = threading.Thread(target=print, args=("kept",))
        other.start()
        other.join()
    assert sys.stdout is stream
    print("after")
    assert stream.getvalue() == "kept\nafter\n"


def test_threads_that_overlap_restore_the_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first to enter leaves first: a redirection that each undid for itself would stay for ever."""
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stdout", stream)
    entered, leave = threading.Event(), threading.Event()

    def second() -> None:
        with muted_output():
            entered.set()
            leave.wait(10)
            print("noise")

    thread = threading.Thread(target=second)
    with muted_output():
        thread.start()
        assert entered.wait(10)
    print("kept")
    leave.set()
    thread.join()
    assert sys.stdout is stream
    assert stream.getvalue() == "kept\n"


def test_other_redirection_in_between_is_respected(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "stdout", first)
    with muted_output():
        sys.stdout = second
    assert sys.stdout is second


def test_progress_in_a_log_is_one_line_at_the_end(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(track(iter("abc"), 3, "resolving")) == ["a", "b", "c"]
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("resolving: 3 of 3 frames, ")
    assert captured.err.count("\n") == 1


def test_progress_lines_come_now_and_then(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(0, 1000, 4))  # 4 s a frame
    monkeypatch.setattr("cltaa.progress.time.monotonic", lambda: float(next(clock)))
    list(track(range(7), 7, "resolving"))
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == [f"resolving: {n} of 7 frames" for n in (3, 6, 7)]
    assert all(line.endswith("0.2 frames/s") for line in lines)
