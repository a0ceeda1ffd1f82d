"""``cltaa bench``: the group of the measuring commands."""

from __future__ import annotations

import click

from cltaa.lazy import Entry, LazyGroup

MEASUREMENTS: dict[str, Entry] = {}


@click.group(cls=LazyGroup, entries=MEASUREMENTS)
def bench() -> None:
    """Measure time, and what accuracy costs in it."""
