"""``cltaa check``: find wrong conventions in a sequence."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import click
import msgspec

from cltaa.commands.options import FILE_PATH, SOME_FRAMES, input_options, json_option, one_sequence
from cltaa.commands.printing import print_line
from cltaa.errors import DataError
from cltaa.inputs.profile import toml_text
from cltaa.io.atomic import atomic_path, check_creatable
from cltaa.io.names import selection_of
from cltaa.lab.check.report import FRAMES, Report, check_folder, profile_options
from cltaa.printable import counted, json_of, printable, shown


@click.command(context_settings={"allow_extra_args": True})  # a shell expands a pattern into many files
@click.argument("sequence", type=FILE_PATH)
@input_options
@click.option(
    "--frames",
    type=SOME_FRAMES,
    default=FRAMES,
    help="Only these frames, both included, or the first N; jitter mistakes need 8 or more to tell them apart.",
)
@click.option("--fix", type=FILE_PATH, metavar="FILE.toml", help="Write a profile with all corrections, for --profile.")
@json_option
@click.pass_context
def check(
    ctx: click.Context,
    /,
    sequence: Path,
    frames: int | tuple[int, int],
    fix: Path | None,
    as_json: bool,
    **reading: Any,
) -> None:
    """Find wrong conventions in SEQUENCE from its pixels: jitter, motion, depth, matrices, colour.

    Each finding has a confidence, its evidence, and the option of cltaa resolve that corrects it. A finding below 80 %
    is a question and suggests no option. The exit code is 0 if no mistake is found, else 65.
    """
    if fix is not None:
        check_creatable(fix)  # fail before the work, not after it
    named = one_sequence(ctx, sequence)
    report, mended = check_folder(named, frames=frames, **reading)
    if fix is not None:
        told = msgspec.structs.replace(mended, description=printable(f"What cltaa check found in {report.folder}"))
        with atomic_path(fix) as temporary:
            temporary.write_text(toml_text(told), encoding="utf-8")
    if as_json:
        click.echo(json_of(report))
    else:
        options = report.options if fix is None else profile_options(str(fix), reading["side_file"], reading["step"])
        _print(report, selection_of(named).words, options)
        if fix is not None and not any(finding.fix for finding in report.mistakes):
            print_line(f"{shown(str(fix))} mends nothing: it reads the sequence as it was read")
    if report.mistakes:
        ctx.exit(DataError.exit_code)


def _print(report: Report, words: tuple[str, ...], options: str) -> None:
    """Print the findings, and the command that reads the sequence ``words`` correctly with ``options``."""
    for line in report.reading[:2]:
        print_line(shown(line), "dim")
    for finding in report.findings:
        sign = "[red]✗[/]" if finding.mistake else "[yellow]?[/]" if finding.question else "[yellow]·[/]"
        text = f"{sign} [bold]{finding.name}[/] ({finding.confidence:.0%}): {shown(finding.what)}"
        print_line(text)
        print_line(f"    {shown(finding.evidence)}", "dim")
        if finding.option:
            print_line(f"    {shown(finding.option)}")
    for line in report.unverifiable:
        print_line(f"[yellow]?[/] cannot tell {shown(line)}")
    if report.questions and not report.mistakes:
        print_line(f"no mistake is certain in {counted(report.frames, 'frame')}; look at what is asked")
    elif not report.mistakes:
        print_line(f"[green]✓[/] no mistake found in {counted(report.frames, 'frame')}")
    elif any(finding.fix for finding in report.mistakes):
        text = f"cltaa resolve {shlex.join(words)} {options}"
        print_line(f"to read it right: {shown(text)}")
