"""Tables of figures on standard output."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

WIDEST = 1000  # columns; no table of ours comes near


def print_table(table: Table) -> None:
    """Print ``table`` as wide as it is: a terminal that is narrower breaks its lines, and no figure is cut short."""
    console = Console()
    needed = console.measure(table, options=console.options.update(max_width=WIDEST)).maximum
    Console(width=max(console.width, needed)).print(table)
