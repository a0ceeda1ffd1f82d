"""Progress of a run on standard error: a bar where a person looks on, a plain line now and then where a log does."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")

SECONDS_BETWEEN_LINES = 10.0  # in a log


def track(frames: Iterable[Item], total: int, action: str, unit: str = "frames") -> Iterator[Item]:
    """Iterate ``frames`` and show how many of ``total`` are through, frames a second and the time left.

    On a terminal that is a bar which vanishes at the end; elsewhere a line every ten seconds and one at the end.
    ``action`` is what is being done, in the present: "resolving"; ``unit`` is what is counted.
    """
    if not sys.stderr.isatty():
        yield from _lines(frames, total, action, unit)
        return
    from cltaa.progress_bar import progress_bar  # here: importing rich takes as long as several frames

    with progress_bar(action, unit) as progress:
        task = progress.add_task(action, total=total)
        for frame in frames:
            yield frame
            progress.advance(task)


def _lines(frames: Iterable[Item], total: int, action: str, unit: str) -> Iterator[Item]:
    begin = last = time.monotonic()
    for done, frame in enumerate(frames, start=1):
        yield frame
        now = time.monotonic()
        if now - last >= SECONDS_BETWEEN_LINES or done == total:
            last = now
            rate = done / max(now - begin, 1e-9)
            print(f"{action}: {done} of {total} {unit}, {rate:.1f} {unit}/s", file=sys.stderr)
