"""``cltaa profiles``: the reader profiles that come with cltaa."""

from __future__ import annotations

import click
from rich.table import Table

from cltaa.commands.names import PROFILE
from cltaa.commands.options import json_option
from cltaa.commands.printing import Console
from cltaa.inputs.profile import load_profile, profile_names
from cltaa.inputs.profile_text import toml_text
from cltaa.printable import json_of


@click.command()
@click.argument("name", required=False, type=PROFILE)
@json_option
def profiles(name: str | None, as_json: bool) -> None:
    """List the reader profiles, or print every key of NAME as TOML to start one's own from."""
    if name is not None:
        profile = load_profile(name)
        click.echo(json_of(profile) if as_json else toml_text(profile), nl=as_json)
        return
    if as_json:
        rows = [{"profile": known, "description": load_profile(known).description} for known in profile_names()]
        click.echo(json_of(rows))
        return
    table = Table("profile", "what it reads", box=None)
    for known in profile_names():
        table.add_row(known, load_profile(known).description)
    Console().print(table)
