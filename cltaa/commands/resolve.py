"""``cltaa resolve``: anti-alias a captured sequence over time."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import click

from cltaa.commands.options import (
    COUNT,
    COUNT_OR_0,
    FILE_PATH,
    LAYERS,
    PRESET,
    SECONDS,
    SOME_FRAMES,
    assigned,
    chosen_effects,
    denoise_option,
    effects_option,
    frame_range,
    input_options,
    json_option,
    one_sequence,
    preset_of,
    storage_option,
    verify_option,
)
from cltaa.core.build import Storage
from cltaa.core.debug import View, parse_views
from cltaa.core.frame_checks import MeaninglessNumbers
from cltaa.core.parameters import Fireflies
from cltaa.errors import UsageError
from cltaa.inputs.open import open_input
from cltaa.io.numbered import OnBreak
from cltaa.pipeline.checkpoint import CHECKPOINT_EVERY
from cltaa.pipeline.folder import for_denoised, resolve_folder
from cltaa.pipeline.run import COMPARISONS, ResolveReport, stage_rows
from cltaa.printable import counted, json_of, printable, shown
from cltaa.process import stop_signals


@click.command(
    "resolve",
    epilog="Parameters for --set and --config, with their ranges: cltaa presets --parameters",
    context_settings={"allow_extra_args": True},  # a shell expands a pattern into many files
)
@click.argument("sequence", type=FILE_PATH)
@click.option("-o", "--output", type=FILE_PATH, required=True, help="Folder for the resolved EXR frames.")
@click.option("--preset", type=PRESET, default="default", help="Named settings; cltaa presets lists them.")
@click.option("--config", type=FILE_PATH, help="TOML file of parameters that override the preset.")
@click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="Override one parameter; repeatable.")
@click.option(
    "--look-ahead",
    type=COUNT_OR_0,
    help="Also gather from N later frames; for gather presets.  [default: the preset's]",
)
@click.option(
    "--jobs",
    type=COUNT,
    help="Resolve N parts of the sequence in parallel, spread over all devices of the same name; for gather presets. "
    "The result has the same bits. Each part first reads the frames that its ring holds, and saves no checkpoints.  "
    "[default: 1]",
)
@click.option(
    "--dask",
    metavar="ADDRESS",
    help="Resolve parts on the workers of the Dask cluster whose scheduler has this address; same bits. Workers need "
    "the folders under the same paths, and equal devices (pip extra cltaa[dask]).  [parts: --jobs, else the workers' "
    "threads]",
)
@click.option("--device", help="OpenCL device, by index or part of its name, or numpy.  [default: first, GPUs first]")
@effects_option
@click.option("--frames", type=SOME_FRAMES, help="Only these frames, both included, or the first N.")
@click.option(
    "--follow",
    is_flag=True,
    help="Resolve a folder while a renderer writes it, each frame once it is complete, until the last of --frames, "
    "--idle, or Ctrl-C.",
)
@click.option(
    "--idle", type=SECONDS, metavar="SECONDS", help="End --follow after this time without a frame.  [default: never]"
)
@click.option(
    "--preview",
    type=FILE_PATH,
    help="Also write the result as an MP4, at the first file's framesPerSecond, else the capture's rate, else 24.",
)
@click.option(
    "--compare",
    type=click.Choice(COMPARISONS),
    help="In the --preview, show the input beside the result (side), or split by a moving line (wipe).",
)
@click.option("--half", is_flag=True, help="Write half-precision EXRs; larger values become 65504.")
@click.option("--compression", help="Lossless EXR compression.  [default: the input's, else zip]")
@click.option(
    "--layers",
    type=LAYERS,
    help="Input channels to copy into the result: all, none, or comma-separated names with * as wildcard.  "
    "[default: all for other tools' files]",
)
@storage_option
@click.option("--strict", is_flag=True, help="Build kernels that match the NumPy oracle bit for bit.")
@input_options
@verify_option
@click.option(
    "--band-rows", type=COUNT_OR_0, help="Resolve in bands of N rows (0: whole images).  [default: as memory allows]"
)
@click.option(
    "--gaps",
    type=click.Choice([mode.value for mode in OnBreak]),
    default=OnBreak.ERROR.value,
    help="On a missing frame: stop with an error, or begin a new history after it.",
)
@click.option(
    "--on-resize",
    type=click.Choice([mode.value for mode in OnBreak]),
    default=OnBreak.ERROR.value,
    help="When the frame size changes: stop with an error, or begin a new history.",
)
@click.option(
    "--fireflies",
    type=click.Choice([kind.value for kind in Fireflies]),
    help="Keep or clamp isolated samples far brighter than their neighbourhood and history.  "
    "[default: as the profile says]",
)
@denoise_option
@click.option("--restart", is_flag=True, help="Delete an earlier run's frames in the output folder and begin again.")
@click.option(
    "--checkpoint",
    "checkpoint_every",
    type=COUNT,
    default=CHECKPOINT_EVERY,
    help="Save the history every N frames, for a run that is killed.",
)
@click.option(
    "--debug",
    "views",
    default="",
    show_default=False,
    metavar="LIST",
    help=f"Also write per-pixel decisions as EXR layers and PNGs, comma-separated: {', '.join(View)}.",
)
@json_option
@click.pass_context
def resolve(
    ctx: click.Context,
    /,
    sequence: Path,
    output: Path,
    preset: str,
    config: Path | None,
    changes: tuple[str, ...],
    look_ahead: int | None,
    effects: str,
    frames: int | tuple[int, int] | None,
    follow: bool,
    preview: Path | None,
    compare: str | None,
    storage: str,
    denoise: str,
    views: str,
    as_json: bool,
    **options: Any,
) -> None:
    """Anti-alias SEQUENCE, a folder of EXR frames or a pattern (x.####.exr), over time.

    Reading, resolving and writing overlap, and only a few frames are in memory at a time. The same command continues
    an interrupted run, with the same bits as one whole run. --follow waits for files that are half written.
    """
    if compare is not None and preview is None:
        raise UsageError(f"--compare {compare} needs a film", cure="name it: --preview FILE.mp4")
    # After a bare --debug, which shows tracebacks, an extra word was probably meant as a debug view.
    hint = f"; --debug takes views: {', '.join(View)}" if ctx.find_root().params.get("debug") else ""
    named = one_sequence(ctx, sequence, hint)
    if follow and not isinstance(named, Path):
        cure = "name the folder, or quote the pattern, as in 'x.####.exr'"
        raise UsageError("--follow looks for files that are not there yet", found="a list of files", cure=cure)
    if follow and isinstance(frames, int):
        cure = f"say which: --frames 1-{frames}"
        raise UsageError("--follow cannot tell yet which frames are the first", found=f"--frames {frames}", cure=cure)
    # The remaining options go to resolve_folder unchanged.
    names = ("profile", "assignments", "side_file", "step", "verify", "gaps", "on_resize")
    reading = {name: options.pop(name) for name in names}
    reading["frames"] = frames if follow else frame_range(named, frames, **reading)
    source = sequence if follow else open_input(named, **reading)
    notes = () if isinstance(source, Path) else source.notes
    if notes:
        click.echo("\n".join(map(printable, notes)), err=True)
    declared = chosen_effects(effects)
    settings = assigned(preset_of(preset, config, None if denoise == "none" else for_denoised), changes)
    if look_ahead is not None:
        settings = assigned(settings, (f"look_ahead={look_ahead}",), "--look-ahead")
    warnings.simplefilter("ignore", MeaninglessNumbers)  # the report names their frames
    report = resolve_folder(
        source,
        output,
        settings,
        effects=declared,
        storage=Storage(storage),
        debug=parse_views(views),
        progress=True,
        follow=follow,
        reading=reading if follow else {},
        preview=preview,
        denoise=denoise,
        compare=compare,
        stopping=stop_signals(),
        **options,
    )
    if as_json:
        click.echo(json_of(report))
    else:
        _print_report(report, preview, views, foreign=bool(notes))


def _print_report(report: ResolveReport, preview: Path | None, views: str, *, foreign: bool) -> None:
    # Imported here, after all frames are written, so that the imports do not delay the first frame.
    from cltaa.commands.printing import figures, print_line, print_table
    from cltaa.inputs.intake import OPAQUE
    from cltaa.io.pixel_statistics import meaningless_lines, missing_lines

    what = f"{counted(report.frames, 'frame')}, {report.width} x {report.height}, preset {shown(report.preset)}"
    print_line(what)
    if report.resolved:
        table = figures(None, "stage", "ms a frame", named=True)
        for name, milliseconds in stage_rows(report.seconds):
            table.add_row(name, f"{milliseconds:.1f}", end_section=name == "write")
        print_table(table)
        print_line("stages: medians, side by side; whole: the clock over all frames, with building kernels", "dim")
    if report.resolved < report.frames:
        print_line(f"{counted(report.frames - report.resolved, 'frame')} finished already")
    if report.repaired:
        print_line(f"{counted(report.repaired, 'missing sample')}: the history stands in, or else what lies around")
        for line in missing_lines(report.missing):
            print_line(f"  {line}")
    for line in meaningless_lines(report.meaningless):
        print_line(line)
    if report.saturated:
        print_line(f"{counted(report.saturated, 'pixel')} saturated at 65504, the largest half")
    if report.cuts_found:
        numbers = ", ".join(map(str, report.cuts_found))
        print_line(f"cut found at frame {numbers}, which nothing declares: a new history")
    if foreign and report.opaque == report.resolved > 0:
        print_line(OPAQUE)
    print_line(f"on {shown(report.device)}")
    print_line(f"written to {shown(report.output)}")
    if views:
        print_line(f"debug views in {shown(report.output)}/debug")
    if preview is not None:
        print_line(f"film {shown(str(preview))}")
