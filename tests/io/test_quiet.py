"""What OpenEXR prints while it decodes is swallowed; what anything else prints is not."""

from __future__ import annotations

import ctypes
import io
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from rich.console import Console

from cltaa.errors import DataError
from cltaa.io.exr_write import write_frame
from cltaa.io.openexr import _Complaints, muted_output
from cltaa.progress import progress_bar, track
from tests.sequence_factory import make_frame, read_frame

PATIENCE = 300.0  # seconds after which a thread counts as hung


def test_only_this_thread_is_muted(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stdout", stream)
    with muted_output():
        print("noise", flush=True)
        other = threading.Thread(target=print, args=("kept",))
        other.start()
        other.join()
    assert sys.stdout is stream
    print("after")
    assert stream.getvalue() == "kept\nafter\n"


def test_complaints_of_c_code_are_muted_and_come_back(capfd: pytest.CaptureFixture[str]) -> None:
    library = ctypes.CDLL(None)
    library.perror(b"before")
    with muted_output():
        library.perror(b"noise")
        print("kept", file=sys.stderr)
        other = threading.Thread(target=print, args=("too",), kwargs={"file": sys.stderr})
        other.start()
        other.join()
    library.perror(b"after")
    assert [line.split(":")[0] for line in capfd.readouterr().err.splitlines()] == ["before", "kept", "too", "after"]


def test_without_a_null_device_complaints_are_heard(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """C code that complains to a stream that is none would take the process with it."""
    monkeypatch.setattr("os.devnull", "/dev/null/none")
    complaints = _Complaints()
    complaints.mute(True)
    ctypes.CDLL(None).perror(b"heard")
    complaints.mute(False)
    assert capfd.readouterr().err.startswith("heard")


def test_damaged_pixels_are_one_error_and_no_noise(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """OpenEXR's C library has two lines of its own to say about each such file."""
    frame = make_frame(width=64, height=64)
    frame.colour[...] = 0.5  # compressible: every chunk has a checksum
    write_frame(tmp_path / "a.0000.exr", frame)
    content = bytearray((tmp_path / "a.0000.exr").read_bytes())
    for place in range(len(content) - 200, len(content) - 10):
        content[place] ^= 0x55
    (tmp_path / "a.0000.exr").write_bytes(content)
    with pytest.raises(DataError, match="pixels are damaged"):
        read_frame(tmp_path / "a.0000.exr")
    assert capfd.readouterr() == ("", "")


def test_threads_that_overlap_restore_the_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first to enter leaves first: a redirection that each undid for itself would stay for ever."""
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stdout", stream)
    entered, leave = threading.Event(), threading.Event()

    def second() -> None:
        with muted_output():
            entered.set()
            leave.wait(PATIENCE)
            print("noise")

    thread = threading.Thread(target=second)
    with muted_output():
        thread.start()
        assert entered.wait(PATIENCE)
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


def test_progress_shows_a_name_to_the_letter(capsys: pytest.CaptureFixture[str]) -> None:
    name = "judging a{0}[b]:fire:"  # no field, no markup, no emoji
    assert list(track("a", 1, f"{name}\x1b[2J")) == ["a"]
    assert capsys.readouterr().err.startswith(f"{name}\\x1b[2J: 1 of 1")
    bar = progress_bar("frames")
    bar.add_task(name, total=1)
    drawn = io.StringIO()
    Console(file=drawn, width=200).print(bar.get_renderable())
    assert name in drawn.getvalue()


PRINTING = """
import sys, threading, time
from cltaa.io.openexr import muted_output

class Slow:  # as a pipe whose reader is busy: other threads run while it takes the text
    def write(self, text):
        time.sleep(0.002)
        return len(text)
    def flush(self):
        pass

def mute():
    while not done:
        with muted_output():
            time.sleep(0.001)

done, sys.stdout = False, Slow()
thread = threading.Thread(target=mute)
thread.start()
for _ in range(100):
    print("written")
done = True
thread.join()
"""


def test_printing_while_another_thread_is_muted_does_not_crash() -> None:
    child = subprocess.run([sys.executable, "-c", PRINTING], capture_output=True, text=True, check=False)
    assert (child.returncode, child.stderr) == (0, "")
