"""The process that cltaa runs in: its cores, what the command line changes of it, signals, and commands in others.

A program that imports cltaa keeps its environment, signal handlers, standard streams, and settings of other libraries:
all changes hang on ``configure`` and on what handles signals. Those reach the main thread only; in another one nothing
here changes anything. A signal that the process was started to ignore, by nohup or as a shell's background job, stays
ignored.
"""

from __future__ import annotations

import ctypes
import os
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any, SupportsIndex

from cltaa.errors import CltaaError, UsageError

# Where nothing else is asked for: pyopencl's cache would only repeat the drivers', and its lock outlives a killed
# process. NumPy's linear algebra starts a thread a core, which then waits busily, and our matrices are 4x4. FLIP's
# module brings an OpenMP of its own, whose threads spin while they wait: nine times as long on a busy machine.
ENVIRONMENT = {"PYOPENCL_NO_CACHE": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}

# glibc's malloc.h: which parameter of mallopt, and its value.
BY_ITSELF = 128 * 2**10  # bytes that glibc takes for both unless told
M_TRIM_THRESHOLD, NEVER = -1, 2**31 - 1  # bytes of free memory at the end of the heap that go back to the system
M_MMAP_THRESHOLD, LARGEST = -3, 32 * 2**20  # bytes from which on a block is mapped on its own; glibc takes no more

_own = False
_waiting: list[Callable[[], None]] = []


def configure() -> None:
    """Take this process for cltaa's own, and set it up: before NumPy, pyopencl and flip_evaluator are imported.

    For the command line and processes that it starts; another call changes nothing.
    """
    global _own
    _own = True
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    with suppress(RuntimeError):  # a folder of our own keeps other programs out of PoCL's cache
        os.environ["POCL_CACHE_DIR"] = os.environ.get("POCL_CACHE_DIR") or str(user_cache() / "cltaa" / "pocl")
    _keep_heap()
    while _waiting:
        _waiting.pop()()


def _keep_heap() -> None:
    """Let glibc keep what is freed: OpenEXR's module allocates the channels of each frame anew, and pages that were
    given back fault again, which takes a third of the time of reading."""
    _set_heap(NEVER, LARGEST)


def give_heap_back() -> None:
    """Let glibc give back what is freed after all, in cltaa's own process: where memory counts more than time."""
    once_own(lambda: _set_heap(BY_ITSELF, BY_ITSELF))


def _set_heap(trimmed: int, mapped: int) -> None:
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):  # other C libraries have none
        library.mallopt(M_TRIM_THRESHOLD, trimmed)
        library.mallopt(M_MMAP_THRESHOLD, mapped)


def is_own() -> bool:
    """Whether the process is cltaa's own; else it is that of a program that uses the library."""
    return _own


def once_own(change: Callable[[], None]) -> None:
    """Change the process now, or when it is configured, or never."""
    if _own:
        change()
    else:
        _waiting.append(change)


def user_cache() -> Path:
    """The user's folder for what can be made again; raises RuntimeError where the user has no home.

    A relative XDG_CACHE_HOME is none (XDG Base Directory Specification, Basics): each folder of work would get one.
    """
    chosen = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return chosen if chosen.is_absolute() else Path.home() / ".cache"


CORES, MANY_CORES = len(os.sched_getaffinity(0)), 8


class OneProcess:
    """Neither copied nor pickled, which is one line: UsageError."""

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        """Refuse what ``copy`` and ``pickle`` ask for."""
        raise no_copy(self)


def no_copy(held: object) -> UsageError:
    """The error for something that cannot be copied, since it holds a device."""
    what = f"a {type(held).__name__} holds a device of this process and cannot be copied or pickled"
    return UsageError(what, cure="make one in each process")


def call_cltaa(arguments: list[str]) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, whatever its exit code; what it prints is kept, its standard error goes to ours."""
    command = [sys.executable, "-m", "cltaa", *arguments]
    # What a shell asks of us to complete is not asked of the child.
    environment = {name: value for name, value in os.environ.items() if name != "_CLTAA_COMPLETE"}
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False, env=environment)


def run_cltaa(arguments: list[str]) -> str:
    """What a command prints; raises CltaaError with its exit code where it fails, with its own words above."""
    done = call_cltaa(arguments)
    if done.returncode:
        error = CltaaError(f"cltaa {shlex.join(arguments)} failed", found=f"exit code {done.returncode}")
        error.exit_code = done.returncode
        raise error
    return done.stdout


SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stop:
    """Whether a signal asked the run to stop."""

    requested = False


_asked = Stop()


@contextmanager
def interrupts(stop: Stop) -> Iterator[None]:
    """Let SIGTERM raise KeyboardInterrupt, as SIGINT does, so that whatever is half-done is cleared away.

    ``stop`` remembers it, because what is raised while another package is imported, or in a call back from C, may get
    lost there, or come out as another error.
    """
    global _asked

    def interrupt(number: int, frame: FrameType | None) -> None:
        stop.requested = True
        signal.default_int_handler(number, frame)

    before, _asked = _asked, stop
    try:
        with _handled(interrupt):
            yield
    finally:
        _asked = before


def stop_where_asked() -> None:
    """Raise KeyboardInterrupt where an earlier one got lost, as ``interrupts`` remembers."""
    if _asked.requested:
        raise KeyboardInterrupt


@contextmanager
def stop_signals() -> Iterator[Stop]:
    """Note the first SIGINT or SIGTERM instead of acting on it; a second one acts as if this were not here."""
    stop = Stop()

    def note(_: int, __: FrameType | None) -> None:
        stop.requested = True
        restore()

    with _handled(note) as restore:
        yield stop


def ends_at_once(code: int) -> None:
    """From now on SIGINT and SIGTERM end the process, with ``code`` and without waiting for its threads.

    For the time when all is said: Python waits for threads then, and takes an exception there for the end of the wait.
    """
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: os._exit(code))


def ignore_signals() -> None:
    """Let SIGINT and SIGTERM do nothing: once the interpreter is taken down, they would end it by their number."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def _handled(handler: Callable[[int, FrameType | None], Any]) -> Iterator[Callable[[], None]]:
    """Handle SIGNALS by ``handler`` until the end, or until what this yields is called."""
    reached = threading.current_thread() is threading.main_thread()
    found = {number: signal.getsignal(number) for number in SIGNALS if reached}
    earlier = {number: before for number, before in found.items() if before is not signal.SIG_IGN}

    def restore() -> None:
        for number, before in earlier.items():
            signal.signal(number, before)

    for number in earlier:
        signal.signal(number, handler)
    try:
        yield restore
    finally:
        restore()
