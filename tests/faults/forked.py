"""``python -m tests.faults.forked TOP SHIM WORK HOW SIGNAL COUNT``: runs that a signal ends.

Every run is a fork of this process, which has imported everything and used nothing of it, neither threads nor drivers:
a process that dies costs a tenth of a second instead of one or two. WORK: a key of ``runs.WORK``. HOW ``steps``:
the signal comes at each COUNT-th open, write, flush or rename in the output folder, of a fresh run each (``shim.c``).
HOW ``calls``: the signal comes when the main thread calls its n-th function, for COUNT random n, whatever the threads
beside it do by then; the runs go on in one folder until it is finished, then anew.
The invariants are checked after each run, and at the end that every frame has the bits of a run that met no signal.
Prints one line of JSON for each run.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import random
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from functools import partial
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import patch

import OpenEXR

import cltaa.commands.resolve
import cltaa.reference
import cltaa_capture.cli
from cltaa import cli
from cltaa.pipeline.checkpoint import SLOTS
from cltaa.process import SIGNALS, configure, ends_at_once
from tests.faults.runs import RECORDS, WORK, Work, check_after_fault, check_finished
from tests.sequence_factory import digests

PRELOADED = (cltaa.commands.resolve, cltaa.reference, cltaa_capture.cli)
PATIENCE = 180.0  # seconds after which a run of a few small frames counts as hung, on a machine however busy
BROKEN = 99  # the exit code of a fork whose assertion failed
INTERRUPTED = 130
LATE = ("cltaa_capture.sequence", "cltaa_datasets.scenes")  # what a capture alone imports, and not before it draws


def wait_until_alone() -> None:
    """A thread that was joined is listed a moment longer; one that stays would be missing in a fork."""
    end = time.monotonic() + PATIENCE
    while len(threads := list(Path("/proc/self/task").iterdir())) > 1:
        assert time.monotonic() < end, threads
        time.sleep(0.001)


class Forks:
    """Work in forks, one at a time; what it prints goes into a file."""

    def __init__(self, top: Path) -> None:
        self.said = top / "said"

    def start(self, work: Callable[[], int]) -> int:
        """Begin ``work``, whose result is the exit code, in a fork; returns its process number."""
        wait_until_alone()
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)  # until the fork is ready for them (see ``Ended.resolve``)
        process = os.fork()
        if process:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
            return process
        code = BROKEN
        try:
            OpenEXR.set_global_thread_count(2)
            with self.said.open("w") as file, contextlib.redirect_stdout(file), contextlib.redirect_stderr(file):
                try:
                    code = work()
                except BaseException:
                    traceback.print_exc()
        finally:
            os._exit(code)

    def end(self, process: int) -> int:
        """Wait for a fork: its exit code, or the number of the signal that ended it, negative."""
        deadline = time.monotonic() + PATIENCE
        while (state := os.waitpid(process, os.WNOHANG)) == (0, 0):
            if time.monotonic() > deadline:
                os.kill(process, signal.SIGKILL)
                raise TimeoutError("a run hangs")
            time.sleep(0.001)
        return os.waitstatus_to_exitcode(state[1])

    def run(self, work: Callable[[], int]) -> int:
        """Do ``work`` in a fork and return its result."""
        code = self.end(self.start(work))
        assert code != BROKEN, self.said.read_text()
        return code


class Ended:
    """Runs of one command that a signal ends, and what has to be so after each."""

    def __init__(self, top: Path, work: Work, number: int, shim: ctypes.CDLL) -> None:
        self.forks, self.top, self.work, self.number, self.shim = Forks(top), top, work, number, shim
        self.whole: dict[str, str] = {}
        self.calls = count(1)

        def prepared() -> int:
            work.prepare(top)
            shim.fault_arm(str(top / "whole").encode(), 1 << 30, -number, 0)  # at no step: they are counted
            code = self.once(top / "whole", 0)
            (top / "steps").write_text(str(shim.fault_calls()))
            (top / "calls").write_text(str(next(self.calls)))
            return code

        assert self.forks.run(prepared) == 0, self.forks.said.read_text()
        self.whole |= digests(top / "whole")

    def once(self, output: Path, at: int | None = None) -> int:
        """One run, which signals reach from where the command line has begun to where it has ended; where ``at`` is
        given its calls of functions are counted, and the signal comes at that one."""
        command = cli.root.main

        def called(_frame: object, event: str, _argument: object) -> None:
            if event == "call" and next(self.calls) == at:
                (self.top / "there").write_text(str(len(list(output.glob("[!.]*.exr")))))
                os.kill(os.getpid(), self.number)

        def open_to_signals(*given: Any, **named: Any) -> Any:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
            sys.setprofile(called if at is not None else None)
            try:
                return command(*given, **named)
            finally:
                sys.setprofile(None)
                signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)

        # As of a process of its own: threads that pack stay, and none of them is closed to a signal when all is said.
        ends_at_once(INTERRUPTED)
        with patch.object(cli.root, "main", open_to_signals):
            return cli.main(self.work.command(self.top, output))

    def check(self, output: Path, code: int) -> int:
        """The invariants after a run; returns the number of frames that are there."""
        said = self.forks.said.read_text()
        kept = self.forks.run(lambda: check_after_fault(output, self.whole))
        expected = -signal.SIGKILL if self.number == signal.SIGKILL else INTERRUPTED
        assert code in (0, expected), (code, said)
        if self.work.records == RECORDS and code == INTERRUPTED and 0 < kept < len(self.whole):
            assert any((output / name).exists() for name in SLOTS)
        return kept

    def finish(self, output: Path) -> None:
        def work() -> int:
            assert self.once(output) == 0
            check_finished(output, self.whole, self.work.records)
            return 0

        self.forks.run(work)

    def at_each_step(self, stride: int) -> None:
        output = self.top / "out"

        def armed(at: int) -> int:
            self.shim.fault_arm(str(output).encode(), at, -self.number, 0)
            return self.once(output)

        for at in range(1, int((self.top / "steps").read_text()) + 1, stride):
            shutil.rmtree(output, ignore_errors=True)
            code = self.forks.run(partial(armed, at))
            kept = self.check(output, code)
            self.finish(output)
            print(json.dumps({"at": at, "code": code, "kept": kept}), flush=True)

    def at_any_call(self, met: int) -> None:
        chance, output, before, round_ = random.Random(0), self.top / "out", 0, 0
        last = int((self.top / "calls").read_text())
        while met:
            (self.top / "there").unlink(missing_ok=True)
            code = self.forks.run(partial(self.once, output, chance.randint(1, last)))
            kept = self.check(output, code)
            met -= code != 0  # a run that goes on has fewer calls, and may end before
            early = (self.top / "there").exists() and (self.top / "there").read_text() == "0"
            # Of seven images not all that were resolved can wait to be the first that is written.
            assert code or not early or self.work.records != RECORDS, "a signal before the first image was not heeded"
            assert kept >= before, "a finished frame was lost"
            before = kept
            print(json.dumps({"code": code, "kept": kept}), flush=True)
            if kept == len(self.whole):
                self.finish(output)
                round_, before = round_ + 1, 0
                output = self.top / f"out{round_}"
        self.finish(output)


if __name__ == "__main__":
    warnings.simplefilter("error")
    configure()
    OpenEXR.set_global_thread_count(0)
    folder, library, name, how, signal_number, given = sys.argv[1:]
    if name == "capture":
        for each in LATE:
            import_module(each)
    runs = Ended(Path(folder), WORK[name], int(signal_number), ctypes.CDLL(library))
    if how == "steps":
        runs.at_each_step(int(given))
    else:
        runs.at_any_call(int(given))
