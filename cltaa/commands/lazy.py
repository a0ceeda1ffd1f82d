"""Command groups that import a subcommand's module only when the subcommand is used."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any, NamedTuple

import click
from click.shell_completion import CompletionItem


class Entry(NamedTuple):
    """Where a subcommand lives and the line that ``--help`` says about it."""

    module: str
    command: str
    summary: str


class LazyGroup(click.Group):
    """A click group over a table of entries: listing and completing them imports none of them."""

    def __init__(self, *arguments: Any, entries: Mapping[str, Entry], **others: Any) -> None:
        super().__init__(*arguments, **others)
        self.entries = entries

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return every name, sorted."""
        return sorted(self.entries)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one subcommand, or None for an unknown name."""
        if cmd_name not in self.entries:
            return None
        entry = self.entries[cmd_name]
        command: click.Command = getattr(importlib.import_module(entry.module), entry.command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click does, which suggests for a misspelt one commands that are imported: here those that can be."""
        try:
            return super().resolve_command(ctx, args)
        except click.NoSuchCommand as error:
            raise click.NoSuchCommand(error.command_name, possibilities=self.entries, ctx=ctx) from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of subcommands without importing them."""
        rows = [(name, self.entries[name].summary) for name in self.list_commands(ctx)]
        if rows:
            with formatter.section("Commands"):
                formatter.write_dl(rows)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete subcommands without importing them, then options."""
        names = [CompletionItem(n, help=e.summary) for n, e in sorted(self.entries.items()) if n.startswith(incomplete)]
        return names + click.Command.shell_complete(self, ctx, incomplete)
