"""The bar that a person sees on a terminal."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from cltaa.process import is_own


class _RateColumn(ProgressColumn):
    """Frames (or whatever ``unit`` says) a second since the start."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """Format the rate, or nothing before the first frame."""
        rate = task.finished_speed or task.speed
        return Text("" if rate is None else f"{rate:.1f} {self._unit}/s", style="progress.data.speed")


def progress_bar(unit: str) -> Progress:
    """A bar on standard error that shows a task's description and ``unit`` a second, and vanishes at the end."""
    description = TextColumn("{task.description}", markup=False)
    columns = (description, BarColumn(), MofNCompleteColumn(), _RateColumn(unit), TimeRemainingColumn())
    own = is_own()  # what is printed above the bar goes through it then
    return Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=own, redirect_stderr=own)
