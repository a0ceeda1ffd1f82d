"""``cltaa inspect``: the contents and problems of a sequence, and the plan of its resolve."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

import click
from rich.table import Table

from cltaa.commands.options import (
    COUNT,
    COUNT_OR_0,
    FILE_PATH,
    LAYERS,
    PRESET,
    SOME_FRAMES,
    assigned,
    chosen_effects,
    denoise_option,
    frame_range,
    input_options,
    json_option,
    one_sequence,
    preset_of,
    refuse_given,
    storage_option,
)
from cltaa.commands.printing import Console, answer, figures, listing, print_line, print_table
from cltaa.core.build import Storage
from cltaa.errors import DataError, UsageError
from cltaa.inputs.open import open_input
from cltaa.io.names import selection_of
from cltaa.io.pixel_statistics import ChannelStatistics
from cltaa.lab.inspect.findings import Description, Inspection, inspect_input
from cltaa.lab.inspect.plan import Section, SequencePlan, plan
from cltaa.pipeline.folder import for_denoised
from cltaa.printable import bytes_of, counted, printable, shown, written
from cltaa.progress import shown_progress


def print_plan(plan: SequencePlan) -> None:
    """Print a table for each run of frames with one plan; a repeated plan only refers to the earlier table."""
    builds = counted(plan.kernels, "build")
    print_line(f"preset {shown(plan.preset)}, {builds} of the resolve, on {shown(plan.device)}")
    parts = {
        "on the device": plan.memory.device,
        "of frames": plan.memory.frames,
        "of results": plan.memory.results,
        **({"of layers": plan.memory.layers} if plan.memory.layers else {}),
        "of reading": plan.memory.reading,
        "of packing": plan.memory.packing,
    }
    told, jobs = " + ".join(f"{size / 1e6:.0f} {what}" for what, size in parts.items()), plan.memory.jobs
    told = f"{told if jobs == 1 else f'{jobs} jobs x ({told})'} + {plan.memory.program / 1e6:.0f} of the program"
    print_line(f"memory at the peak, without film and debug views: {plan.memory.whole / 1e6:.0f} MB = {told}")
    if plan.found is not None:
        print_line(shown(plan.found.line))
        table = listing("effect", "found", "why")
        for each in plan.found.evidence:
            table.add_row(each.effect, "yes" if each.found else "no", shown(each.why))
        Console().print(table)
    before: dict[tuple[tuple[str, bool, str], ...], str] = {}
    for section in plan.sections:
        first, last = section.first, section.last
        frames = f"frame {first}" if first == last else f"frames {first} to {last}"
        title = frames + (", history begins" if section.starts else "")
        key = tuple((step.name, step.on, step.why) for step in section.steps)
        if key in before:
            print_line(f"{title}: as {before[key]}")
            continue
        before[key] = frames
        Console().print(_table(section, title))


def _table(section: Section, title: str) -> Table:
    planned, every = section.milliseconds, section.every_milliseconds
    if planned is not None and every is not None:
        # Excludes steps that change the result, such as the illumination-change test: those only have their own rows.
        same_bits = f"{every:.2f} with every step that leaves the bits as they are ({every / planned:.2f} x)"
        title += f": {planned:.2f} ms a frame, {same_bits}"
    table = listing("step", "runs", "why", title=title)
    table.add_column("ms a frame", justify="right")
    for step in section.steps:
        cost = "" if step.milliseconds is None else f"{step.milliseconds:+.2f}"
        # Brackets mark the cost that a step would have if it ran.
        cost = cost if step.on or not cost else f"({cost})"
        table.add_row(step.name, "yes" if step.on else "no", shown(step.why), cost)
    return table


CENTRED_TO_PX = 1e-3  # a larger mean jitter visibly shifts the image
OF_PLAN = {*signature(plan).parameters, "config", "changes"}


@click.command(context_settings={"allow_extra_args": True})  # a shell expands a pattern into many files
@click.argument("folder", metavar="SEQUENCE", type=FILE_PATH)
@click.option("--frames", type=SOME_FRAMES, help="Only these frames, both included, or the first N.")
@click.option("--pixels", is_flag=True, help="Also decode every frame: ranges, NaN, infinities, false declarations.")
@click.option("--plan", "planned", is_flag=True, help="Instead print the steps of a resolve, with reason and cost.")
@click.option("--preset", type=PRESET, default="default", help="With --plan: preset to plan for.")
@click.option("--device", metavar="NAME", help="With --plan: OpenCL device, by index or part of its name.")
@click.option(
    "--effects",
    metavar="LIST",
    default="auto",
    help="With --plan: auto, find, all, none, or a list, as for cltaa resolve.",
)
@click.option("--config", type=FILE_PATH, help="With --plan: TOML file of parameters that override the preset.")
@click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="With --plan: set a parameter; repeatable.")
@partial(storage_option, where="With --plan: ")
@click.option("--band-rows", type=COUNT_OR_0, help="With --plan: in bands of N rows (0: whole images).")
@click.option("--half", is_flag=True, help="With --plan: plan for half-precision results, which take less memory.")
@click.option("--layers", type=LAYERS, help="With --plan: input channels to copy into the result, as in cltaa resolve.")
@partial(denoise_option, where="With --plan: ")
@click.option("--jobs", type=COUNT, default=1, help="With --plan: N parts at once, each of which takes memory.")
@input_options
@json_option
@click.pass_context
def inspect(
    ctx: click.Context,
    /,
    folder: Path,
    frames: int | tuple[int, int] | None,
    pixels: bool,
    planned: bool,
    preset: str,
    device: str | None,
    effects: str,
    config: Path | None,
    changes: tuple[str, ...],
    storage: str,
    band_rows: int | None,
    half: bool,
    layers: tuple[str, ...] | None,
    denoise: str,
    jobs: int,
    as_json: bool,
    **reading: Any,
) -> None:
    """Describe a captured sequence: size, channels, effects, jitter, camera, cuts, truth, and every problem.

    SEQUENCE is a folder of frames, a pattern (x.####.exr, x.%04d.exr, 'x.*.exr'), or one or more files.

    Reads only headers, well under a millisecond a frame, and still finds truncated files. The exit code is 0 if there
    is no problem, else 65. For another tool's files it prints how they would be read, and with --pixels the values
    that a resolve would get. --plan prints the plan of a resolve instead; if no effects are declared, it finds them
    in the pixels of a few frames.
    """
    if planned and pixels:
        raise UsageError("--pixels and --plan are two reports", cure="leave one of them out")
    if not planned:
        refuse_given(ctx, OF_PLAN, "says how to plan a resolve", "add --plan")
    place = selection_of(one_sequence(ctx, folder))
    reading["frames"] = frame_range(place, frames, **reading)
    if planned:
        wanted = assigned(preset_of(preset, config, None if denoise == "none" else for_denoised), changes)
        source = open_input(place, **reading)
        if source.notes:
            click.echo("\n".join(map(printable, source.notes)), err=True)
        resolved: dict[str, Any] = {"half": half, "layers": layers, "band_rows": band_rows, "denoise": denoise}
        resolved |= {"effects": chosen_effects(effects), "storage": Storage(storage), "jobs": jobs}
        answer(plan(source, wanted, device, **resolved), as_json, print_plan)
        return
    with shown_progress("inspecting") if sys.stderr.isatty() else nullcontext() as advance:
        found = inspect_input(place, pixels=pixels, advance=advance, **reading)
    answer(found, as_json, _print)
    if found.problems:
        ctx.exit(DataError.exit_code)


def _print(found: Inspection | Description) -> None:
    own = isinstance(found, Inspection)
    for name, text in _facts(found) if isinstance(found, Inspection) else _facts_of_reading(found):
        print_line(f"[dim]{name:<11}[/] {shown(text)}")  # never wrapped, so that options in it can be pasted back
    if found.statistics:
        print_table(_statistics(found.statistics))
    for idle in found.idle if isinstance(found, Inspection) else ():
        print_line(f"[yellow]![/] {shown(idle)}")
    for problem in found.problems:
        print_line(f"[red]✗[/] {shown(problem)}")
    if not found.problems and (own or found.statistics):
        print_line("[green]✓[/] no problem found")


def _facts_of_reading(found: Description) -> list[tuple[str, str]]:
    if not found.profile:
        return [("folder", found.folder)]
    return [
        ("profile", f"{found.profile}: {found.reason}"),
        ("frames", f"{found.frames}: {found.first} to {found.last}, {found.size}"),
        *((role, written(channels)) for role, channels in found.channels.items()),
        *([("exposure", _range(found.exposures))] if found.exposures != (1.0, 1.0) else []),
        *([("cuts", ", ".join(map(str, found.cuts)))] if found.cuts else []),
        ("also there", written(found.unused) or "nothing"),
        *(("without", note) for note in found.notes),
    ]


def _range(found: tuple[float, float]) -> str:
    return f"{found[0]:g}" if found[0] == found[1] else f"{found[0]:g} to {found[1]:g}"


def _facts(found: Inspection) -> list[tuple[str, str]]:
    kinds = sorted(set(found.channels.values()))
    by_kind = (f"{written(n for n, k in found.channels.items() if k == kind)} ({kind})" for kind in kinds)
    return [
        ("sequence", f"{found.name} in {found.folder}"),
        ("scene", found.scene or "not named"),
        *([("resolved by", found.resolved_by)] if found.resolved_by else []),
        ("frames", f"{found.frames}: {found.first} to {found.last}"),
        ("size", found.size),
        ("channels", ", ".join(by_kind) or "unknown"),
        ("effects", "not declared" if found.effects is None else ", ".join(found.effects) or "none"),
        ("jitter", _jitter(found)),
        ("camera", _camera(found)),
        ("cuts", ", ".join(map(str, found.cuts)) or "none"),
        ("exposure", _range(found.exposures)),
        ("reference", _reference(found)),
        ("on disk", f"{bytes_of(found.disk_bytes)}, {found.compression or 'unknown compression'}"),
    ]


def _camera(found: Inspection) -> str:
    return f"{found.camera}, {'orthographic' if found.orthographic else 'perspective'}" if found.camera else "unknown"


def _jitter(found: Inspection) -> str:
    jitter = found.jitter
    if jitter is None:
        return "unknown"
    if jitter.largest_px == 0:
        return "none"
    period = {None: "no repetition", 1: "always the same"}.get(jitter.period, f"repeats after {jitter.period}")
    x, y = (round(component, 4) + 0.0 for component in jitter.mean_px)  # + 0.0 turns -0 into 0
    biased = jitter.period is not None and max(map(abs, jitter.mean_px)) > CENTRED_TO_PX
    mean = f"mean ({x:g}, {y:g}) px{' (not centred: the image is shifted by it)' if biased else ''}"
    return f"{period}, {mean}, at most {jitter.largest_px:.3f} px"


def _reference(found: Inspection) -> str:
    if found.reference is None:
        return "none"
    samples = found.reference.samples
    return f"{counted(found.reference.frames, 'frame')}" + (
        "" if samples is None else f" of {counted(samples, 'sample')} a pixel"
    )


def _statistics(statistics: dict[str, ChannelStatistics]) -> Table:
    table = figures(None, "channel", "lowest", "highest", "NaN", "infinite", named=True)
    for name, channel in statistics.items():
        ends = (f"{channel.lowest:.6g}", f"{channel.highest:.6g}") if channel.lowest <= channel.highest else ("–", "–")
        table.add_row(shown(name), *ends, str(channel.nan), str(channel.infinite))
    return table
