"""Lines and tables of what a command found, in which names from outside stay as they are (``printable.shown``)."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from copy import copy
from functools import partial
from typing import TypeVar

import click
from rich import console
from rich.table import Table

from cltaa.printable import json_of

Found = TypeVar("Found")

WIDEST = 1000  # columns; no table of ours comes near

Console = partial(console.Console, highlight=False, emoji=False)  # numbers are not coloured, nor :names: drawn


def print_line(text: str, style: str | None = None) -> None:
    """Print ``text``, which may have markup of rich's, as the one line that it is."""
    Console().print(text, style=style, soft_wrap=True)


def three_digits(value: float) -> str:
    """A number to three digits, and one of thousands in full: no reader takes ``2.57e+03`` in at a glance."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def answer(found: Found, as_json: bool, tell: Callable[[Found], object]) -> None:
    """Print what was found as JSON, or for a reader as ``tell`` does."""
    if as_json:
        click.echo(json_of(found))
    else:
        tell(found)


def figures(title: str | None, *headings: str, named: bool = False) -> Table:
    """A table of figures, each whole and to the right; with ``named`` the first column is of names, to the left."""
    table = Table(title=title)
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="left" if named and not place else "right", no_wrap=True)
    return table


def listing(*headings: str, title: str | None = None) -> Table:
    """A table of words without lines between them."""
    return Table(*headings, title=title, title_justify="left", box=None, padding=(0, 2, 0, 0))


def print_table(table: Table) -> None:
    """Print ``table`` without a figure cut short: where it is wider than the terminal, some columns after the others.

    Each part begins with the first column, and is as wide as it has to be. A file or a pipe has no width, unless the
    variable COLUMNS gives it one.
    """
    console = Console()
    room = console.width if console.is_terminal or "COLUMNS" in os.environ else WIDEST
    for part in _parts(table, room):
        Console(width=max(console.width, _width(part))).print(part)


def _parts(table: Table, room: int) -> Iterator[Table]:
    """The table, or as many columns of it at a time as fit into ``room``, behind its first."""
    last, begin = len(table.columns), 1
    while begin < last or begin == 1:
        end = last
        while end > begin + 1 and _width(_with(table, begin, end)) > room:
            end -= 1
        yield _with(table, begin, end)
        begin = max(end, begin + 1)


def _with(table: Table, begin: int, end: int) -> Table:
    """The table with its first column and those from ``begin`` to before ``end``; its title over the first alone."""
    if (begin, end) == (1, len(table.columns)):
        return table
    part, chosen = copy(table), [table.columns[0], *table.columns[begin:end]]
    part.columns, part.rows = [], []
    part.title = table.title if begin == 1 else None
    for column in chosen:
        part.add_column(column.header, justify=column.justify, no_wrap=column.no_wrap, style=column.style)
    for row, cells in zip(table.rows, zip(*(column.cells for column in chosen), strict=True), strict=True):
        part.add_row(*cells, style=row.style, end_section=row.end_section)
    return part


def _width(table: Table) -> int:
    """Columns of a terminal that a table takes where nothing in it is wrapped."""
    ruler = Console(width=WIDEST)
    return ruler.measure(table).maximum
