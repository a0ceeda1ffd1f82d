"""``cltaa bench files``: what files cost, and how well the stages of a resolve overlap."""

from __future__ import annotations

from pathlib import Path

import click
from rich.table import Table

from cltaa.commands.options import (
    FILE_PATH,
    FROM_1,
    NAMES,
    PRESET,
    device_option,
    json_option,
    open_each,
    reading_options,
)
from cltaa.commands.printing import print_line, print_table
from cltaa.core.presets import load_preset
from cltaa.errors import UsageError
from cltaa.inputs.open import Reading
from cltaa.io.exr_layout import check_lossless
from cltaa.lab.bench.files import CODECS, FilesBench, bench_files
from cltaa.lab.timing import Interval
from cltaa.printable import counted, json_of, shown

MOST_THREADS = 1024  # beyond what machines have; where the system gives none, OpenEXR ends the process


@click.command("files")
@click.argument("sequence", type=FILE_PATH)
@click.option("--preset", type=PRESET, default="default", show_default=True, help="That resolves.")
@device_option
@click.option("--compressions", type=NAMES, default=",".join(CODECS), show_default=True, help="Of EXR, lossless.")
@click.option("--threads", type=FROM_1, default="", help="Threads of OpenEXR.  [default: a thread a core]")
@click.option(
    "--commands",
    "commands",
    type=NAMES,
    default="zip",
    show_default=True,
    help="Compressions to run the whole command with; with :half behind it, writing halves.",
)
@click.option("--rounds", default=5, show_default=True, type=click.IntRange(min=3), help="Rounds.")
@reading_options
@json_option
def files(
    sequence: Path,
    preset: str,
    device: str | None,
    compressions: tuple[str, ...],
    threads: tuple[int, ...],
    commands: tuple[str, ...],
    rounds: int,
    reading: Reading,
    as_json: bool,
) -> None:
    """Time writing and reading a resolved frame of SEQUENCE, and the whole resolve against its stages.

    "alone" is a stage with nothing beside it: reading (with all checks), resolving (with the way to the device and
    back) and writing. "whole" is cltaa resolve --layers none, where they overlap; "over slowest" is its time a frame
    over that of the slowest stage, which it cannot pass, and "at best" what that would be if no core was ever idle, by
    the "processor" time of all of them together.
    """
    runs = [_command(text) for text in commands]
    if not compressions and not runs:
        raise UsageError("nothing to time", cure="name something in --compressions or --commands")
    if max(threads, default=1) > MOST_THREADS:
        raise UsageError("--threads: too many", expected=f"at most {MOST_THREADS}", found=max(threads))
    for name in (*compressions, *(name for name, _ in runs)):
        check_lossless(name)
    found = bench_files(
        open_each([sequence], reading)[sequence],
        load_preset(preset),
        device,
        codecs=compressions,
        threads=threads,
        commands=runs,
        rounds=rounds,
    )
    if as_json:
        click.echo(json_of(found))
    else:
        _print(found)


def _command(text: str) -> tuple[str, bool]:
    name, colon, kind = text.partition(":")
    if colon and kind != "half":
        raise UsageError("--commands: no compression", expected="as zip or zip:half", found=text)
    return name, bool(colon)


def _print(found: FilesBench) -> None:
    table = Table(title=f"a resolved frame, {found.width} x {found.height}, {found.rounds} rounds")
    for heading in ("compression", "pixels", "threads", "write ms", "95 %", "read ms", "95 %", "MB"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in found.packings:
        table.add_row(
            row.codec,
            "half" if row.half else "float",
            str(row.threads),
            f"{row.write.median:.0f}",
            _range(row.write),
            f"{row.read.median:.0f}",
            _range(row.read),
            f"{row.megabytes:.1f}",
        )
    if found.packings:
        print_table(table)
    table = Table(title=f"cltaa resolve, {counted(found.frames, 'frame')}, milliseconds a frame")
    alone = ("read alone", "resolve alone", "write alone")
    for heading in ("compression", *alone, "whole", "processor", "over slowest", "95 %", "at best"):
        table.add_column(heading, justify="right", no_wrap=True)
    for stage in found.stages:
        seconds = (stage.read, stage.resolve, stage.write, stage.whole, stage.processor)
        ratio, best = stage.over_slowest, stage.at_best
        table.add_row(
            stage.codec + (", half" if stage.half else ""),
            *(f"{value.median * 1e3:.0f}" for value in seconds),
            f"{ratio.median:.2f}",
            _range(ratio, ".2f"),
            f"{best.median:.2f}",
        )
    if found.stages:
        print_table(table)
    print_line(shown(found.environment.line))


def _range(value: Interval, form: str = ".0f") -> str:
    return f"{value.low:{form}}–{value.high:{form}}"
