"""SIGINT and SIGTERM: the same exception, and a wish that a long run grants between two frames.

Signals reach the main thread only; in another one nothing here changes anything. One that the process was started to
ignore, by nohup or as a shell's background job, stays ignored.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stop:
    """Whether a signal asked the run to stop."""

    requested = False


@contextmanager
def interrupts(stop: Stop) -> Iterator[None]:
    """Let SIGTERM raise KeyboardInterrupt, as SIGINT does, so that whatever is half-done is cleared away.

    ``stop`` remembers it, because what is raised while another package is imported may get lost there, or come out as
    another error.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        stop.requested = True
        signal.default_int_handler(number, frame)

    with _handled(SIGNALS, interrupt):
        yield


@contextmanager
def stop_signals() -> Iterator[Stop]:
    """Note the first SIGINT or SIGTERM instead of acting on it; a second one acts as if this were not here."""
    stop = Stop()

    def note(_: int, __: FrameType | None) -> None:
        stop.requested = True
        restore()

    with _handled(SIGNALS, note) as restore:
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
def _handled(
    numbers: tuple[signal.Signals, ...], handler: Callable[[int, FrameType | None], Any]
) -> Iterator[Callable[[], None]]:
    """Handle signals by ``handler`` until the end, or until what this yields is called."""
    reached = threading.current_thread() is threading.main_thread()
    found = {number: signal.getsignal(number) for number in numbers if reached}
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
