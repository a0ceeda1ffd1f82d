"""Options that several subcommands share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

Command = Callable[..., Any]

verify_option = click.option(
    "--verify/--no-verify",
    default=True,
    show_default=True,
    help="Refuse a file whose SHA-256 is not the one recorded beside it (sequence.json, manifest.jsonl).",
)


def input_options(command: Command) -> Command:
    """Add ``--profile``, ``--input`` and ``--camera``: how the files of a sequence are read."""
    for option in (
        click.option("--camera", type=click.Path(path_type=Path), metavar="FILE",
                     help="Matrices and jitter of each frame: .json, .csv or text (docs/inputs.md)."),
        click.option("--input", "inputs", multiple=True, metavar="SECTION.KEY=VALUE",
                     help="One key of the profile, such as motion.scale=1,-1; may be repeated."),
        click.option("--profile", default="auto", show_default=True,
                     help="Who wrote the files: auto, a name (cltaa profiles), or FILE.toml."),
    ):  # fmt: skip
        command = option(command)
    return command
