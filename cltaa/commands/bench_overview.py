"""``cltaa bench overview``: several accuracy reports of one device as one figure and one table."""

from __future__ import annotations

from pathlib import Path

import click

from cltaa.bench.accuracy.report import falling_metrics, merged, read_report, write_report
from cltaa.commands.options import FILE_PATH, json_option
from cltaa.errors import UsageError
from cltaa.files.atomic import make_folder
from cltaa.printable import json_of


@click.command("overview")
@click.argument("reports", nargs=-1, required=True, type=FILE_PATH, metavar="REPORT...")
@click.option("-o", "--output", required=True, type=FILE_PATH, help="Folder to write into.")
@click.option("--pictured", default=4, show_default=True, type=click.IntRange(min=0),
              help="Sequences, the first ones, that have plots of their own.")  # fmt: skip
@json_option
def overview(reports: tuple[Path, ...], output: Path, pictured: int, as_json: bool) -> None:
    """Put the reports of cltaa bench accuracy together: their sequences in one figure, one table, one JSON and CSV.

    Each REPORT is the folder of one; all must be of the same device, kernels and variants, as when several processes,
    each on a card of its own, measured some of the sequences.
    """
    result = merged([(folder, read_report(folder)) for folder in reports])
    if not falling_metrics(result):
        raise UsageError("no error to compare by: no metric that falls with it", found=", ".join(result.metrics))
    make_folder(output)
    text = write_report(result, output, pictured, of_one=True)
    click.echo(json_of(result) if as_json else text, nl=as_json)
