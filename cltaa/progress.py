"""Progress of a run on standard error: a bar on a terminal, elsewhere a line now and then."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from cltaa.printable import printable
from cltaa.process import is_own, stop_where_asked

Item = TypeVar("Item")
Advance = Callable[[int, int], None]  # takes how many are done, and of how many

SECONDS_BETWEEN_LINES = 10.0  # in a log


def track(
    items: Iterable[Item], total: int, action: str, unit: str = "frames", *, shown: bool = False
) -> Iterator[Item]:
    """Iterate ``items`` and show how many of ``total`` are done, items a second and the time left.

    ``action`` is a present participle such as "resolving"; ``unit`` names the items. In a program that uses the library
    nothing is shown unless it asks for it (``shown``).
    """
    with shown_progress(action, unit, shown=shown or is_own()) as advance:
        advance(0, total)
        for done, item in enumerate(items, start=1):
            yield item
            advance(done, total)


@contextmanager
def shown_progress(action: str, unit: str = "frames", *, shown: bool = True) -> Iterator[Advance]:
    """Yield a function to call before the first item and after each, which does nothing unless ``shown``.

    On a terminal it moves a bar that vanishes at the end; elsewhere it prints a line every ten seconds and at the end.
    It raises an interrupt that got lost since the last item.
    """
    if not shown:
        yield lambda _done, _total: None
        return
    action = printable(action)  # may hold text from a file
    if not sys.stderr.isatty():
        yield _stopping(_lines(action, unit))
        return

    with progress_bar(unit) as bar:
        task = bar.add_task(action, total=None)
        yield _stopping(lambda done, total: bar.update(task, completed=done, total=total))


def _stopping(show: Advance) -> Advance:
    def advance(done: int, total: int) -> None:
        stop_where_asked()
        show(done, total)

    return advance


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


class _RateColumn(ProgressColumn):
    """Items a second since the start, named by ``unit``."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """Format the rate, or nothing before the first frame."""
        rate = task.finished_speed or task.speed
        return Text("" if rate is None else f"{rate:.1f} {self._unit}/s", style="progress.data.speed")


def progress_bar(unit: str) -> Progress:
    """Return a bar on standard error that shows a task's description and ``unit`` a second, and vanishes at the end."""
    description = TextColumn("{task.description}", markup=False)
    columns = (description, BarColumn(), MofNCompleteColumn(), _RateColumn(unit), TimeRemainingColumn())
    own = is_own()  # then other output is printed above the bar
    return Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=own, redirect_stderr=own)
