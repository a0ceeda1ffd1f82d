"""``cltaa resolve``: anti-alias a captured sequence over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from cltaa.commands.options import (
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
    context_settings={"allow_extra_args": True},  # of files that a shell lists
)
@click.argument("sequence", type=FILE_PATH)
@click.option("-o", "--output", type=FILE_PATH, required=True, help="Folder for the resolved EXRs.")
@click.option("--preset", type=PRESET, default="default", help="Named settings; list them with: cltaa presets")
@click.option("--config", type=FILE_PATH, help="TOML file of parameters, over the preset.")
@click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="One parameter; may be repeated.")
@click.option(
    "--look-ahead",
    type=click.IntRange(min=0),
    metavar="N",
    help="Gather from the N frames behind each one too; for presets that keep frames.  [default: the preset's]",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Resolve N parts of the sequence at once, on all devices of the same name in turn, to the same bits; for "
    "presets that gather. Each part first reads the frames that its ring holds; no checkpoints.  [default: 1]",
)
@click.option(
    "--dask",
    metavar="ADDRESS",
    help="Resolve parts on the workers of a Dask cluster, to the same bits: the scheduler's address. They need the "
    "folders under the same paths, and like devices; the extra cltaa[dask].  [parts: --jobs, or their threads]",
)
@click.option("--device", help="Part of an OpenCL device's name, its index, or numpy.  [default: first, GPUs first]")
@effects_option
@click.option("--frames", type=SOME_FRAMES, help="Only these frames, both included, or the first N.")
@click.option(
    "--follow",
    is_flag=True,
    help="Resolve a folder that is still being written, each frame as it is finished, up to the last of --frames, "
    "until --idle or Ctrl-C.",
)
@click.option(
    "--idle",
    type=SECONDS,
    metavar="SECONDS",
    help="End --follow when no frame came for so long.  [default: wait for ever]",
)
@click.option(
    "--preview",
    type=FILE_PATH,
    help="Also write the result as an MP4, as fast as captured, as framesPerSecond says, or at 24.",
)
@click.option(
    "--compare",
    type=click.Choice(COMPARISONS),
    help="Of the --preview: the input beside the result, or both parted by a line that sweeps.",
)
@click.option("--half", is_flag=True, help="Write half-precision EXRs (values saturate at 65504).")
@click.option("--compression", help="EXR compression that loses nothing.  [default: the input's, else zip]")
@click.option(
    "--layers",
    type=LAYERS,
    help="Channels of the input to keep beside the resolved ones: all, none, or names separated by commas, "
    "* for anything.  [default: all of other tools' files]",
)
@storage_option
@click.option("--strict", is_flag=True, help="Kernels that match the NumPy oracle bit for bit.")
@input_options
@verify_option
@click.option(
    "--band-rows",
    type=click.IntRange(min=0),
    metavar="N",
    help="Resolve in bands of N rows (0: whole images).  [default: as memory asks]",
)
@click.option(
    "--gaps",
    type=click.Choice([mode.value for mode in OnBreak]),
    default=OnBreak.ERROR.value,
    help="A missing frame: refuse it, or begin a new history behind it.",
)
@click.option(
    "--on-resize",
    type=click.Choice([mode.value for mode in OnBreak]),
    default=OnBreak.ERROR.value,
    help="Another size: refuse it, or begin a new history with it.",
)
@click.option(
    "--fireflies",
    type=click.Choice([kind.value for kind in Fireflies]),
    help="Isolated samples far above what lies around them and their history.  [default: as the profile says]",
)
@denoise_option
@click.option("--restart", is_flag=True, help="Begin the output folder anew, whatever it was begun with.")
@click.option(
    "--checkpoint",
    type=click.IntRange(min=1),
    default=CHECKPOINT_EVERY,
    metavar="N",
    help="Save the state every N frames, for a run that goes on after a kill.",
)
@click.option(
    "--debug",
    "views",
    default="",
    show_default=False,
    metavar="LIST",
    help=f"Also show what was decided at each pixel, as EXR layers and PNGs: {', '.join(View)}.",
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
    device: str | None,
    effects: str,
    frames: int | tuple[int, int] | None,
    follow: bool,
    idle: float | None,
    preview: Path | None,
    compare: str | None,
    storage: str,
    gaps: str,
    on_resize: str,
    denoise: str,
    checkpoint: int,
    views: str,
    as_json: bool,
    **options: Any,
) -> None:
    """Anti-alias SEQUENCE, a folder of captured EXR frames or a pattern of them (x.####.exr), over time.

    Reading, the kernels and writing overlap, and only a few frames are in memory at a time. A run that was
    interrupted goes on where it stopped when the same command is given again, to the same bits. With --follow a file
    that is half written is waited for.
    """
    if compare is not None and preview is None:
        raise UsageError(f"--compare {compare} is of a film", cure="name it: --preview FILE.mp4")
    # Behind --debug, which shows tracebacks alone, one may be meant for a view.
    hint = f"; --debug takes views: {', '.join(View)}" if ctx.find_root().params.get("debug") else ""
    if idle is not None and not follow:
        raise UsageError("--idle ends --follow", cure="give both, or neither")
    named = one_sequence(ctx, sequence, hint)
    if follow and not isinstance(named, Path):
        cure = "name the folder, or quote the pattern, as in 'x.####.exr'"
        raise UsageError("--follow looks for files that are not there yet", found="a list of files", cure=cure)
    if follow and isinstance(frames, int):
        cure = f"say which: --frames 1-{frames}"
        raise UsageError("--follow cannot tell yet which frames are the first", found=f"--frames {frames}", cure=cure)
    chosen = frames if follow else frame_range(named, frames)
    # What is left of the options is given to resolve_folder as it is.
    reading = {name: options.pop(name) for name in ("profile", "assignments", "side_file", "step", "verify")}
    reading |= {"gaps": OnBreak(gaps), "on_resize": OnBreak(on_resize), "frames": chosen}
    source = sequence if follow else open_input(named, **reading)
    notes = () if isinstance(source, Path) else source.notes
    if notes:
        click.echo("\n".join(map(printable, notes)), err=True)
    declared = chosen_effects(effects)
    settings = assigned(preset_of(preset, config, None if denoise == "none" else for_denoised), changes)
    if look_ahead is not None:
        settings = assigned(settings, (f"look_ahead={look_ahead}",), "--look-ahead")
    report = resolve_folder(
        source,
        output,
        settings,
        device,
        effects=declared,
        storage=Storage(storage),
        debug=parse_views(views),
        progress=True,
        follow=follow,
        idle=idle,
        reading=reading if follow else {},
        preview=preview,
        denoise=denoise,
        compare=compare,
        checkpoint_every=checkpoint,
        stopping=stop_signals(),
        **options,
    )
    if as_json:
        click.echo(json_of(report))
    else:
        _print_report(report, preview, views, foreign=bool(notes))


def _print_report(report: ResolveReport, preview: Path | None, views: str, *, foreign: bool) -> None:
    # Here: when the frames are written, and not before the first is read.
    from cltaa.commands.printing import figures, print_line, print_table
    from cltaa.inputs.intake import OPAQUE
    from cltaa.io.pixel_statistics import missing_lines

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
