"""Options that several subcommands share."""

from __future__ import annotations

import click

verify_option = click.option(
    "--verify/--no-verify",
    default=True,
    show_default=True,
    help="Refuse a file whose SHA-256 is not the one recorded beside it (sequence.json, manifest.jsonl).",
)
