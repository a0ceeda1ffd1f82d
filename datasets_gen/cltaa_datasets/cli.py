"""``cltaa scenes``: list the scenes."""

from __future__ import annotations

import click

from cltaa.commands.options import json_option
from cltaa.commands.printing import Console, listing
from cltaa.frame import format_effects
from cltaa.printable import json_of
from cltaa_datasets import FORMATS, MOTIONS


@click.command()
@json_option
def scenes(as_json: bool) -> None:
    """List the scenes that cltaa capture can draw, and the effects of each."""
    from cltaa_datasets.scenes import registered  # imported late: loads trimesh, which help must not

    entries = registered()
    if as_json:
        listed = [{"name": e.name, "description": e.description, "effects": sorted(e.effects)} for e in entries]
        click.echo(json_of({"scenes": listed, "file": {"formats": FORMATS, "motions": MOTIONS}}))
        return
    table = listing("scene", "what it shows", "effects")
    for entry in entries:
        table.add_row(entry.name, entry.description, format_effects(entry.effects).replace(",", " "))
    table.add_row("file:PATH", f"your own model ({' '.join(FORMATS)}), --motion {' or '.join(MOTIONS)}", "by motion")
    Console().print(table)
