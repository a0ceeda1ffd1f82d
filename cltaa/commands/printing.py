"""Lines and tables of a command's results; names from outside keep their text (``printable.shown``)."""

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

WIDEST = 1000  # columns, more than any table here needs

Console = partial(console.Console, highlight=False, emoji=False)  # no coloured numbers, no :name: emoji


def print_line(text: str, style: str | None = None) -> None:
    """Print ``text``, which may contain rich markup, as one unwrapped line."""
    Console().print(text, style=style, soft_wrap=True)


def three_digits(value: float) -> str:
    """Format a number to three digits, and from 1000 on in full, because ``2.57e+03`` is hard to read."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def answer(found: Found, as_json: bool, tell: Callable[[Found], object]) -> None:
    """Print ``found`` as JSON, or with ``tell`` for a reader."""
    if as_json:
        click.echo(json_of(found))
    else:
        tell(found)


def figures(title: str | None, *headings: str, named: bool = False) -> Table:
    """Make a table of unwrapped, right-aligned figures; with ``named`` the first column is left-aligned."""
    table = Table(title=title)
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="left" if named and not place else "right", no_wrap=True)
    return table


def listing(*headings: str, title: str | None = None) -> Table:
    """Make a table of words without rules."""
    return Table(*headings, title=title, title_justify="left", box=None, padding=(0, 2, 0, 0))


def print_table(table: Table) -> None:
    """Print ``table`` without truncating a figure: a table wider than the terminal is split by columns.

    Each part repeats the first column. A file or a pipe has no width limit, unless the variable COLUMNS sets one.
    """
    console = Console()
    room = console.width if console.is_terminal or "COLUMNS" in os.environ else WIDEST
    for part in _parts(table, room):
        Console(width=max(console.width, _width(part))).print(part)


def _parts(table: Table, room: int) -> Iterator[Table]:
    """Yield ``table`` in parts, each with the first column and as many others as fit into ``room``."""
    last, begin = len(table.columns), 1
    while begin < last or begin == 1:
        end = last
        while end > begin + 1 and _width(_with(table, begin, end)) > room:
            end -= 1
        yield _with(table, begin, end)
        begin = max(end, begin + 1)


def _with(table: Table, begin: int, end: int) -> Table:
    """Return ``table`` with its first column and columns [begin, end); only the first part keeps the title."""
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
    """Return the terminal columns that ``table`` needs without wrapping."""
    ruler = Console(width=WIDEST)
    return ruler.measure(table).maximum
