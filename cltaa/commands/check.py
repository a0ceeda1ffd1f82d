"""``cltaa check``: find wrong conventions in a sequence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import msgspec

from cltaa.commands.options import FILE_PATH, SOME_FRAMES, frame_range, input_options, json_option, one_sequence
from cltaa.commands.printing import print_line
from cltaa.errors import DataError, UsageError
from cltaa.inputs.convert import correct
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import open_intake
from cltaa.inputs.profile import Jitter, Profile, differences, load_profile, option_text, toml_text
from cltaa.inputs.side_file import read_side_file
from cltaa.io.atomic import atomic_path, check_creatable
from cltaa.io.names import Named, selection_of
from cltaa.io.numbered import FrameRange
from cltaa.lab.check.measured_jitter import measured_jitter, write_jitter
from cltaa.lab.check.report import FRAMES, Report, check_folder, profile_options
from cltaa.printable import counted, json_of, printable, shell_word, shown


@click.command(context_settings={"allow_extra_args": True})  # a shell expands a pattern into many files
@click.argument("sequence", type=FILE_PATH)
@input_options
@click.option(
    "--frames",
    type=SOME_FRAMES,
    help="Only these frames, both included, or the first N; jitter mistakes need 8 or more to tell them apart.  "
    f"[default: {FRAMES}; all for --jitter-file]",
)
@click.option("--fix", type=FILE_PATH, metavar="FILE.toml", help="Write a profile with all corrections, for --profile.")
@click.option(
    "--jitter-file",
    type=FILE_PATH,
    metavar="FILE.json",
    help="Write the jitter of each frame as measured from the pixels, for --camera, or tell why it cannot be measured.",
)
@json_option
@click.pass_context
def check(
    ctx: click.Context,
    /,
    sequence: Path,
    frames: int | tuple[int, int] | None,
    fix: Path | None,
    jitter_file: Path | None,
    as_json: bool,
    **reading: Any,
) -> None:
    """Find wrong conventions in SEQUENCE from its pixels: jitter, motion, depth, matrices, colour.

    Each finding has a confidence, its evidence, and the option of cltaa resolve that corrects it. A finding below 80 %
    is a question and suggests no option. The exit code is 0 if no mistake is found, else 65.
    """
    if jitter_file is not None and jitter_file.suffix.lower() != ".json":
        raise UsageError("--jitter-file writes JSON", expected="FILE.json", found=jitter_file)
    for output in (fix, jitter_file):
        if output is not None:
            check_creatable(output)  # fail before the work, not after it
    if fix is not None and fix.suffix != ".toml":  # by which --profile knows a file
        raise UsageError("--fix writes a profile", expected="FILE.toml", found=fix)
    named = one_sequence(ctx, sequence)
    report, mended = check_folder(named, frames=FRAMES if frames is None else frames, **reading)
    words, options, side_file = selection_of(named).words, report.options, reading["side_file"]
    only = frame_range(named, frames, profile=mended) if jitter_file is not None else None
    if jitter_file is not None:
        try:
            _write_jitter(jitter_file, named, mended, only, reading)
        except DataError:
            if not as_json:
                _print(report, words, options)  # what is to be mended first
            raise
        base = mended.name if reading["profile"] == "auto" else reading["profile"]
        mended, side_file = msgspec.structs.replace(mended, jitter=Jitter()), jitter_file  # the file is in pixels
        report, mended = _with_leak(report, mended, named, jitter_file, only, reading["step"])
        changes = option_text(differences(mended, load_profile(base)))
        options = f"{profile_options(base, side_file, reading['step'])} {changes}".strip()
    if fix is not None:
        told = msgspec.structs.replace(mended, description=printable(f"What cltaa check found in {report.folder}"))
        with atomic_path(fix) as temporary:
            temporary.write_text(toml_text(told), encoding="utf-8")
        options = profile_options(str(fix), side_file, reading["step"])
    options += "" if only is None else f" --frames {only[0]}-{only[1]}"
    if as_json:
        click.echo(json_of(msgspec.structs.replace(report, options=options)))
    else:
        _print(report, words, options)
        if jitter_file is not None:
            print_line(f"the jitter is measured; to resolve with it: {shown(_resolve(words, options))}")
        if fix is not None and not any(finding.fix for finding in report.mistakes):
            print_line(f"{shown(str(fix))} mends nothing: it reads the sequence as it was read")
    if report.mistakes:
        ctx.exit(DataError.exit_code)


def _write_jitter(
    path: Path, named: Named, profile: Profile, frames: FrameRange | None, reading: dict[str, Any]
) -> None:
    """Measure the jitter of the sequence, read by ``profile``, and write it with the rest of its side file."""
    if profile.jitter.source == "projection":
        what, cure = "the matrices hold the jitter already", "leave out --jitter-file"
        raise UsageError(what, expected="a jitter of pixels", found="jitter.source=projection", cure=cure)
    place, told = selection_of(named), {key: reading[key] for key in ("side_file", "step")}
    # Not ``open_input``, which asks cltaa's own files for the jitter that may be missing.
    intake = open_intake(place, profile=profile, frames=frames, **told)
    jitter = measured_jitter(ForeignSequence(place.folder, intake, sorted(intake.declared)))
    write_jitter(path, jitter, read_side_file(reading["side_file"]) if reading["side_file"] else {})


def _with_leak(
    report: Report, mended: Profile, named: Named, jitter_file: Path, only: FrameRange | None, step: int
) -> tuple[Report, Profile]:
    """Add what the vectors contain of the jitter in ``jitter_file``, without which it cannot be found."""
    frames = FRAMES if only is None else (only[0], min(only[1], only[0] + (FRAMES - 1) * step))
    again, _ = check_folder(named, profile=mended, side_file=jitter_file, frames=frames, step=step)
    found = [finding for finding in again.mistakes if "jittered" in finding.fix.get("motion", {})]
    for finding in found:
        mended = correct(mended, finding.fix)
    return msgspec.structs.replace(report, findings=[*report.findings, *found]), mended


def _resolve(words: tuple[str, ...], options: str) -> str:
    return f"cltaa resolve {' '.join(map(shell_word, map(Path, words)))} {options} -o OUT"


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
        print_line(f"to read it right: {shown(_resolve(words, options))}")
