"""Progress of a run on standard error: a bar where a person looks on, a plain line now and then where a log does."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

Item = TypeVar("Item")

SECONDS_BETWEEN_LINES = 10.0  # in a log


class _RateColumn(ProgressColumn):
    """Frames (or whatever ``unit`` says) a second since the start."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """Format the rate, or nothing before the first frame."""
        rate = task.finished_speed or task.speed
        return Text("" if rate is None else f"{rate:.1f} {self._unit}/s", style="progress.data.speed")


def track(frames: Iterable[Item], total: int, action: str, unit: str = "frames") -> Iterator[Item]:
    """Iterate ``frames`` and show how many of ``total`` are through, frames a second and the time left.

    On a terminal that is a bar which vanishes at the end; elsewhere a line every ten seconds and one at the end.
    ``action`` is what is being done, in the present: "resolving"; ``unit`` is what is counted.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield from _lines(frames, total, action, unit, console)
        return
    columns = (TextColumn(action), BarColumn(), MofNCompleteColumn(), _RateColumn(unit), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(action, total=total)
        for frame in frames:
            yield frame
            progress.advance(task)


def _lines(frames: Iterable[Item], total: int, action: str, unit: str, console: Console) -> Iterator[Item]:
    begin = last = time.monotonic()
    for done, frame in enumerate(frames, start=1):
        yield frame
        now = time.monotonic()
        if now - last >= SECONDS_BETWEEN_LINES or done == total:
            last = now
            rate = done / max(now - begin, 1e-9)
            line = f"{action}: {done} of {total} {unit}, {rate:.1f} {unit}/s"
            console.print(line, highlight=False, soft_wrap=True)
