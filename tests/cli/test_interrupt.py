"""What Ctrl-C does to a command: while packages are imported, and again and again while threads write."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from cltaa import cli, errors
from cltaa.io.exr_read import read_image
from cltaa.progress import track


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (NameError("planted"), 130, "cltaa: interrupted"),
        (errors.StorageError("the disk is full"), 74, "cltaa: error: the disk is full"),
    ],
)
def test_interrupt_that_another_module_swallows(
    number: signal.Signals,
    error: Exception,
    code: int,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Packages that are interrupted while they are imported go on without a part of theirs; our own errors stand."""

    def swallowed(*_: object, **__: object) -> None:
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), number)
        raise error

    monkeypatch.setattr(cli.root, "main", swallowed)
    assert cli.main([]) == code
    assert capsys.readouterr().err.startswith(words)


@pytest.mark.parametrize("steps", [lambda steps: track(steps, 9, "working"), list])
def test_an_interrupt_that_is_lost_ends_the_next_step(
    steps: Callable[[range], Iterable[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one in a call back from C, such as of a driver, which has no way to raise it; at the latest the command."""

    def lost(*_: object, **__: object) -> None:
        for _step in steps(range(9)):
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(cli.root, "main", lost)
    assert cli.main([]) == 130


INTERRUPTED = """
import sys
from runpy import run_module
class Finder:
    def find_spec(self, name, *_):
        if name == "click":
            exec("raise KeyboardInterrupt")
sys.meta_path.insert(0, Finder())
run_module("cltaa", run_name="__main__")
"""


def test_an_interrupt_while_the_command_is_imported_is_one_line() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "cltaa: interrupted\n")


WRITING = """
import sys
from pathlib import Path
import numpy as np
from cltaa import cli
from cltaa.io.streams import Writer
def work(*_, **__):
    noise = np.random.default_rng(0).random((1080, 1920), np.float32)
    with Writer() as writer:
        for number in range(50):
            writer.write(Path(sys.argv[1]) / f"{number}.exr", {"R": noise, "G": noise, "B": noise})
            print("written", flush=True)
cli.root.main = work
sys.exit(cli.main())
"""


@pytest.mark.parametrize("pause", [0.005, 0.05])
def test_repeated_interrupts_do_not_abort(tmp_path: Path, pause: float) -> None:
    """While threads write, are waited for, and at last while the interpreter is taken down."""
    arguments = [sys.executable, "-c", WRITING, str(tmp_path)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "written\n"
        while process.poll() is None:
            process.send_signal(signal.SIGINT)
            time.sleep(pause)
        assert process.stderr is not None
        assert process.stderr.read() in ("cltaa: interrupted\n", "")  # the last of many may come before the words
    assert process.returncode == 130
    for path in tmp_path.glob("*.exr"):
        assert read_image(path)[0]["R"].shape == (1080, 1920)
