"""``cltaa profiles``: the reader profiles that come with cltaa."""

from __future__ import annotations

import click
from rich.console import Console
from rich.table import Table

from cltaa.inputs.profile import load_profile, profile_names
from cltaa.inputs.profile_text import toml_text


@click.command()
@click.argument("name", required=False)
def profiles(name: str | None) -> None:
    """List the reader profiles, or print every key of NAME as TOML to start one's own from."""
    if name is not None:
        click.echo(toml_text(load_profile(name)), nl=False)
        return
    table = Table("profile", "what it reads", box=None)
    for known in profile_names():
        table.add_row(known, load_profile(known).description)
    Console().print(table)
