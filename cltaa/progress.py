"""Progress of a run on standard error: a bar where a person looks on, a plain line now and then where a log does."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from cltaa.printable import printable

Item = TypeVar("Item")
Advance = Callable[[int, int], None]  # called with how many are done, and of how many

SECONDS_BETWEEN_LINES = 10.0  # in a log


def track(items: Iterable[Item], total: int, action: str, unit: str = "frames") -> Iterator[Item]:
    """Iterate ``items`` and show how many of ``total`` are through, items a second and the time left.

    ``action`` is what is being done, in the present: "resolving"; ``unit`` is what is counted.
    """
    with shown_progress(action, unit) as advance:
        advance(0, total)
        for done, item in enumerate(items, start=1):
            yield item
            advance(done, total)


@contextmanager
def shown_progress(action: str, unit: str = "frames") -> Iterator[Advance]:
    """Yield what is to be called before the first item and after each.

    On a terminal it moves a bar that vanishes at the end; elsewhere it prints a line every ten seconds and at the end.
    """
    action = printable(action)  # which may be of a file
    if not sys.stderr.isatty():
        yield _lines(action, unit)
        return
    from cltaa.progress_bar import progress_bar  # here: importing rich takes as long as several frames

    with progress_bar(unit) as bar:
        task = bar.add_task(action, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _lines(action: str, unit: str) -> Advance:
    begin = last = time.monotonic()

    def advance(done: int, total: int) -> None:
        nonlocal last
        if not done:
            return
        now = time.monotonic()
        if now - last >= SECONDS_BETWEEN_LINES or done == total:
            last = now
            rate = done / max(now - begin, 1e-9)
            print(f"{action}: {done} of {total} {unit}, {rate:.1f} {unit}/s", file=sys.stderr)

    return advance
