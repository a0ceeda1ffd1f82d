"""The process that cltaa runs in: its cores, the command line's settings, signals, and child processes.

A program that imports cltaa keeps its environment, signal handlers, standard streams, and settings of other libraries:
only ``configure`` and the handlers of signals change them. Handlers are set in the main thread only. A signal that was
ignored when the process started, by nohup or as a shell's background job, stays ignored.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path
from types import FrameType
from typing import Any, SupportsIndex, TypeVar, cast

from cltaa.errors import WRONG_TYPES, CltaaError, UsageError, check_arguments
from cltaa.printable import shell_word

# Defaults that the user's environment overrides. pyopencl's cache would only repeat the drivers', and its lock outlives
# a killed process. NumPy's linear algebra starts a thread per core, which then busy-waits, and our matrices are 4x4.
# FLIP's module brings its own OpenMP, whose threads spin while they wait: nine times as long on a busy machine.
ENVIRONMENT = {"PYOPENCL_NO_CACHE": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}

# glibc's malloc.h: parameters of mallopt, and their values.
BY_ITSELF = 128 * 2**10  # glibc's own default of both, in bytes
M_TRIM_THRESHOLD, NEVER = -1, 2**31 - 1  # bytes of free memory at the end of the heap that go back to the system
M_MMAP_THRESHOLD, LARGEST = -3, 32 * 2**20  # bytes from which on a block is mapped on its own; glibc accepts no more

_own = False
_waiting: list[Callable[[], None]] = []


def configure() -> None:
    """Mark this process as cltaa's own and set it up, before NumPy, pyopencl and flip_evaluator are imported.

    For the command line and the processes that it starts; another call changes nothing.
    """
    global _own
    _own = True
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    with suppress(RuntimeError):  # a folder of our own keeps other programs out of PoCL's cache
        os.environ["POCL_CACHE_DIR"] = os.environ.get("POCL_CACHE_DIR") or str(user_cache() / "cltaa" / "pocl")
    # glibc keeps freed memory: OpenEXR's module allocates the channels of each frame anew, and pages returned to the
    # system fault again, which takes a third of the time of reading.
    _set_heap(NEVER, LARGEST)
    while _waiting:
        _waiting.pop()()


def give_heap_back() -> None:
    """Let glibc return freed memory to the system, in cltaa's own process: where memory counts more than time."""
    once_own(lambda: _set_heap(BY_ITSELF, BY_ITSELF))


def _set_heap(trimmed: int, mapped: int) -> None:
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):  # other C libraries lack it
        library.mallopt(M_TRIM_THRESHOLD, trimmed)
        library.mallopt(M_MMAP_THRESHOLD, mapped)


def is_own() -> bool:
    """True where the process is cltaa's own, False in a program that uses the library."""
    return _own


def once_own(change: Callable[[], None]) -> None:
    """Call ``change`` now if the process is configured, else when it is, which may be never."""
    if _own:
        change()
    else:
        _waiting.append(change)


def user_cache() -> Path:
    """Return the user's cache folder; raises RuntimeError where the user has no home.

    A relative XDG_CACHE_HOME is ignored (XDG Base Directory Specification, Basics): each working folder would get one.
    """
    chosen = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return chosen if chosen.is_absolute() else Path.home() / ".cache"


CORES, MANY_CORES = len(os.sched_getaffinity(0)), 8


class OneProcess:
    """An object that cannot be copied or pickled: either raises UsageError."""

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        """Refuse ``copy`` and ``pickle``."""
        raise no_copy(self)


def no_copy(held: object) -> UsageError:
    """Return the error for copying an object that holds a device."""
    what = f"a {type(held).__name__} holds a device of this process and cannot be copied or pickled"
    return UsageError(what, cure="make one in each process")


def call_cltaa(arguments: list[str]) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, whatever its exit code; captures its output and passes its standard error on."""
    command = [sys.executable, "-m", "cltaa", *arguments]
    # A shell's completion request to us must not reach the child.
    environment = {name: value for name, value in os.environ.items() if name != "_CLTAA_COMPLETE"}
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False, env=environment)


def run_cltaa(arguments: list[str]) -> str:
    """Return the output of a command; raises CltaaError with its exit code where it fails, below its own message."""
    done = call_cltaa(arguments)
    if done.returncode:
        error = CltaaError(f"cltaa {' '.join(map(shell_word, arguments))} failed", found=f"exit code {done.returncode}")
        error.exit_code, error.told = done.returncode, done.returncode > 0  # what a signal ended has told nothing
        raise error
    return done.stdout


SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stop:
    """Whether a signal asked the run to stop."""

    requested = False


_asked = Stop()


@contextmanager
def interrupts(stop: Stop) -> Iterator[None]:
    """Let SIGTERM raise KeyboardInterrupt, as SIGINT does, so that unfinished work is cleaned up.

    ``stop`` records it, because an exception raised during another package's import, or in a callback from C, may get
    lost there, or surface as another error.
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
    """Raise KeyboardInterrupt where an earlier one got lost, as ``interrupts`` records."""
    if _asked.requested:
        raise KeyboardInterrupt


@contextmanager
def stop_signals() -> Iterator[Stop]:
    """Record the first SIGINT or SIGTERM instead of acting on it; a second one acts as usual."""
    stop = Stop()

    def note(_: int, __: FrameType | None) -> None:
        stop.requested = True
        restore()

    with _handled(note) as restore:
        yield stop


def ends_at_once(code: int) -> None:
    """From now on SIGINT and SIGTERM end the process, with ``code`` and without waiting for its threads.

    For the end of a run: Python then waits for threads, and an exception would end that wait early.
    """
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: os._exit(code))


def ignore_signals() -> None:
    """Ignore SIGINT and SIGTERM: during the interpreter's shutdown they would kill it, with the signal's exit code."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def _handled(handler: Callable[[int, FrameType | None], Any]) -> Iterator[Callable[[], None]]:
    """Handle SIGNALS by ``handler`` until the block ends, or until the yielded function is called."""
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


INSIDE = "_inside"  # the attribute that holds the thread inside
CLOSED = "_closed"  # the one that is true of a closed object
Method = TypeVar("Method", bound=Callable[..., Any])


def one_thread(method: Method) -> Method:
    """Make ``method`` raise UsageError while another thread uses the same object, and once that is closed.

    It does not wait for the other: frames come in order, and which of two threads is first is chance.
    """

    @wraps(method)
    def alone(owner: Any, *given: Any, **named: Any) -> Any:
        # Records the thread, without a lock: an interrupt between acquire and try would leave that held for good.
        state, me = vars(owner), threading.get_ident()
        if state.setdefault(INSIDE, me) != me:
            raise UsageError("two threads use one resolver at once", cure="frames come in order: take one a thread")
        try:
            if state.get(CLOSED) and method.__name__ != "_end":  # which close calls, any number of times
                raise UsageError("the resolver is closed", cure="make a new one")
            return method(owner, *given, **named)
        except WRONG_TYPES:
            check_arguments(f"Resolver.{method.__name__}", method, (owner, *given), named)
            raise
        finally:
            state.pop(INSIDE, None)

    return cast(Method, alone)
