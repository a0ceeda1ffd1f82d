"""Lines and tables of what a command found, in which names from outside stay as they are (``printable.shown``)."""

from __future__ import annotations

from functools import partial

from rich import console
from rich.table import Table

WIDEST = 1000  # columns; no table of ours comes near

Console = partial(console.Console, highlight=False, emoji=False)  # numbers are not coloured, nor :names: drawn


def print_line(text: str, style: str | None = None) -> None:
    """Print ``text``, which may have markup of rich's, as the one line that it is."""
    Console().print(text, style=style, soft_wrap=True)


def print_table(table: Table) -> None:
    """Print ``table`` as wide as it is: a terminal that is narrower breaks its lines, and no figure is cut short."""
    console = Console()
    needed = console.measure(table, options=console.options.update(max_width=WIDEST)).maximum
    Console(width=max(console.width, needed)).print(table)
